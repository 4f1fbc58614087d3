defmodule BB.OptionsTest do
  # Captures the output of all processes on stderr.
  use ExUnit.Case, async: false
  use BB.Test.Prop

  import ExUnit.CaptureIO

  alias BB.Options
  alias BB.Options.ValidationError

  doctest BB.Options
  doctest BB.Options.ValidationError

  defmodule Greeter do
    @callback greet() :: String.t()
  end

  defmodule English do
    @behaviour Greeter
    @impl Greeter
    def greet, do: "hello"
  end

  def even(value, _arg) when is_integer(value) and rem(value, 2) == 0, do: {:ok, div(value, 2)}
  def even(value, arg), do: {:error, "expected an even number #{arg}, got: #{inspect(value)}"}

  defp validate(type, value), do: Options.validate([k: value], k: [type: type])

  defp message(type, value) do
    assert {:error, %ValidationError{key: :k, value: ^value} = error} = validate(type, value)
    Exception.message(error)
  end

  describe "types" do
    for {type, good, bad, expected} <- [
          {:float, 1.0, 1, "float"},
          {:integer, 1, 1.0, "integer"},
          {:number, 1, "1", "number"},
          {:boolean, true, nil, "boolean"},
          {:string, "s", :s, "string"},
          {:atom, :s, "s", "atom"},
          {:pos_integer, 1, 0, "positive integer"},
          {:non_neg_integer, 0, -1, "non negative integer"},
          {:timeout, :infinity, -1, "non-negative integer or :infinity"},
          {:keyword_list, [a: 1], [1], "keyword list"},
          {:non_empty_keyword_list, [a: 1], [], "non-empty keyword list"},
          {:module, String, nil, "module"},
          {nil, nil, false, "nil"},
          {:mfa, {String, :upcase, []}, {String, :upcase}, "tuple {mod, fun, args}"},
          {:mod_arg, {String, []}, String, "tuple {mod, arg}"},
          {:map, %{a: 1}, [a: 1], "map"},
          {{:in, [:a, :b]}, :a, :c, "one of [:a, :b]"},
          {{:in, 1..3}, 3, 4, "one of 1..3"},
          {{:literal, 1}, 1, 1.0, "1"},
          {{:list, :atom}, [:a], :a, "list"},
          {{:tuple, [:atom, :integer]}, {:a, 1}, [:a], "tuple"},
          {{:behaviour, Greeter}, English, String, "module that implements #{inspect(Greeter)}"}
        ] do
      test "#{inspect(type)} takes #{inspect(good)} and refuses #{inspect(bad)}" do
        good = unquote(Macro.escape(good))
        assert validate(unquote(Macro.escape(type)), good) == {:ok, [k: good]}

        assert message(unquote(Macro.escape(type)), unquote(Macro.escape(bad))) ==
                 "invalid value for :k option: expected #{unquote(expected)}, got: #{inspect(unquote(Macro.escape(bad)))}"
      end
    end

    test ":any takes everything" do
      assert validate(:any, self()) == {:ok, [k: self()]}
    end

    test ":pid and :reference" do
      assert validate(:pid, self()) == {:ok, [k: self()]}
      assert message(:pid, 1) == "invalid value for :k option: expected pid, got: 1"
      ref = make_ref()
      assert validate(:reference, ref) == {:ok, [k: ref]}
      assert message(:reference, 1) == "invalid value for :k option: expected reference, got: 1"
    end

    test "{:fun, arity} names the arity it got" do
      fun = &String.upcase/1
      assert validate({:fun, 1}, fun) == {:ok, [k: fun]}

      assert message({:fun, 2}, fun) ==
               "invalid value for :k option: expected function of arity 2, got: function of arity 1"

      assert message({:fun, 2}, 1) ==
               "invalid value for :k option: expected function of arity 2, got: 1"
    end

    test "{:struct, module}" do
      assert validate({:struct, Range}, 1..2) == {:ok, [k: 1..2]}

      assert message({:struct, Range}, %{}) ==
               "invalid value for :k option: expected Range, got: %{}"
    end

    test "{:custom, …} may change the value and words its own error" do
      type = {:custom, __MODULE__, :even, ["please"]}
      assert validate(type, 4) == {:ok, [k: 2]}

      assert message(type, 3) ==
               "invalid value for :k option: expected an even number please, got: 3"
    end

    test "{:custom, …} that returns something else raises" do
      assert_raise RuntimeError, ~r/Kernel.is_integer\/1 must return {:ok, value}/, fn ->
        validate({:custom, Kernel, :is_integer, []}, 1)
      end
    end

    test "{:or, …} lists why each type did not fit" do
      assert validate({:or, [:float, nil]}, nil) == {:ok, [k: nil]}

      assert message({:or, [:float, nil]}, 1) == """
             expected :k option to match at least one given type, but didn't match any. Here are the reasons why it didn't match each of the allowed types:

               * invalid value for :k option: expected nil, got: 1
               * invalid value for :k option: expected float, got: 1\
             """
    end

    test "{:or, …} takes nested keyword lists" do
      type = {:or, [:boolean, {:keyword_list, [level: [type: :integer, default: 1]]}]}
      assert validate(type, []) == {:ok, [k: [level: 1]]}

      assert message(type, level: :x) =~
               "* invalid value for :level option: expected integer, got: :x (in options [:k])"
    end

    test "{:list, type} tells the position" do
      assert message({:list, :atom}, [:a, 1]) ==
               "invalid list in :k option: invalid value for list element at position 1: expected atom, got: 1"

      assert message({:list, {:list, :atom}}, [[], [:a, 1]]) ==
               "invalid list in :k option: invalid list in list element at position 1: " <>
                 "invalid value for list element at position 1: expected atom, got: 1"
    end

    test "{:list, type} refuses an improper list" do
      assert message({:list, :integer}, [1 | 2]) =~ "expected list, got: [1 | 2]"
    end

    test "{:list, {:keyword_list, …}} tells the position" do
      type = {:list, {:keyword_list, [level: [type: :integer, required: true]]}}
      assert validate(type, [[level: 1]]) == {:ok, [k: [[level: 1]]]}

      assert message(type, [[level: 1], []]) ==
               "invalid list element at position 1 in :k option: required :level option not found, received options: []"
    end

    test "{:tuple, types} tells the size and the position" do
      assert message({:tuple, [:atom]}, {1, 2}) ==
               "invalid value for :k option: expected tuple with 1 elements, got: {1, 2}"

      assert message({:tuple, [:atom, :atom]}, {:a, 2}) ==
               "invalid tuple in :k option: invalid value for tuple element at position 1: expected atom, got: 2"
    end

    test "{:map, key_type, value_type} tells the key" do
      assert validate({:map, :string, :integer}, %{"a" => 1}) == {:ok, [k: %{"a" => 1}]}

      assert message({:map, :atom, :any}, 1..2) =~ "expected map, got: 1..2"

      assert message({:map, :string, :integer}, %{a: 1}) ==
               "invalid map in :k option: invalid value for map key: expected string, got: :a"

      assert message({:map, :string, :integer}, %{"a" => :b}) ==
               "invalid map in :k option: invalid value for map key \"a\": expected integer, got: :b"
    end

    test "{:wrap_list, type} wraps a single value" do
      assert validate({:wrap_list, :atom}, :a) == {:ok, [k: [:a]]}
      assert validate({:wrap_list, :atom}, [:a, :b]) == {:ok, [k: [:a, :b]]}

      assert message({:wrap_list, :atom}, 1) =~
               "invalid list in :k option: invalid value for list element at position 0"
    end
  end

  describe "options" do
    test "a required one that is missing is named, with those that were given" do
      assert {:error, error} =
               Options.validate([b: 1], a: [required: true], b: [], c: [default: 1])

      assert %ValidationError{key: :a, value: nil, keys_path: []} = error
      assert Exception.message(error) == "required :a option not found, received options: [:b]"
    end

    test "unknown ones are named, with those that are valid" do
      assert {:error, error} = Options.validate([x: 1], a: [], b: [])
      assert Exception.message(error) == "unknown options [:x], valid options are: [:a, :b]"
    end

    test "defaults are filled in, and checked" do
      assert Options.validate([], a: [type: :float, default: 1.0]) == {:ok, [a: 1.0]}

      assert {:error, %ValidationError{key: :a}} =
               Options.validate([], a: [type: :float, default: 1])
    end

    test "the first of two values counts" do
      assert Options.validate([a: 1, a: 2], a: []) == {:ok, [a: 1]}
    end

    test "errors inside options name the way there" do
      schema = [
        filter: [
          type: :keyword_list,
          keys: [window: [type: :keyword_list, keys: [size: [type: :integer]]]]
        ]
      ]

      assert {:error, error} = Options.validate([filter: [window: [size: 1.0]]], schema)
      assert error.keys_path == [:filter, :window]
      assert error.message == "invalid value for :size option: expected integer, got: 1.0"

      assert Exception.message(error) ==
               "invalid value for :size option: expected integer, got: 1.0 (in options [:filter, :window])"
    end

    test "defaults are filled in inside options" do
      schema = [filter: [type: :keyword_list, default: [], keys: [size: [default: 3]]]]
      assert Options.validate([], schema) == {:ok, [filter: [size: 3]]}
    end

    test "the star describes all other options" do
      schema = [*: [type: :integer]]
      assert Options.validate([a: 1, b: 2], schema) == {:ok, [a: 1, b: 2]}
      assert {:error, %ValidationError{key: :b}} = Options.validate([a: 1, b: :c], schema)
    end

    test "a map comes back as a map" do
      assert Options.validate(%{a: 1}, a: [], b: [default: 2]) == {:ok, %{a: 1, b: 2}}
    end

    test "something else than options is an error that shows it" do
      for options <- [1, [1], [:a], "options", [{"a", 1}], 1..2] do
        assert {:error, error} = Options.validate(options, a: [])

        assert Exception.message(error) ==
                 "invalid options: expected keyword list, got: #{inspect(options)}"
      end
    end

    test "validate! returns the options or raises" do
      assert Options.validate!([a: 1], a: []) == [a: 1]

      assert_raise ValidationError, "unknown options [:b], valid options are: [:a]", fn ->
        Options.validate!([b: 1], a: [])
      end
    end
  end

  describe "new!" do
    for {schema, reasons} <- [
          {[a: [type: :no]],
           ["unknown type :no.\n\nAvailable types: :any, ", " (in options [:a])"]},
          {[a: [type: {:list, :no}]], ["invalid subtype given to :list type: unknown type :no"]},
          {[a: [type: {:or, [:atom, 1]}]], ["invalid subtype given to :or type: unknown type 1"]},
          {[a: [requird: true]],
           ["unknown options [:requird], valid options are: [:type, :required"]},
          {[a: [required: 1]], ["invalid value for :required option: expected boolean, got: 1"]},
          {[a: :integer], ["invalid value for :a option: expected keyword list, got: :integer"]},
          {[a: [type: :integer, keys: []]],
           ["expected the type of :a to be :keyword_list", "got: :integer"]},
          {[a: [type: :keyword_list, keys: [b: [type: :no]]]],
           ["unknown type :no", "(in options [:b])"]},
          {:schema, ["invalid options: expected keyword list, got: :schema"]}
        ] do
      test "refuses the schema #{inspect(schema)}" do
        error = assert_raise ArgumentError, fn -> Options.new!(unquote(Macro.escape(schema))) end
        assert error.message =~ "invalid BB.Options schema. Reason: "
        for reason <- unquote(reasons), do: assert(error.message =~ reason)
      end
    end

    test "makes a schema that validate takes" do
      schema = Options.new!(a: [type: :integer])
      assert Options.validate([a: 1], schema) == {:ok, [a: 1]}
      assert Options.new!(schema) == schema
    end
  end

  describe "new" do
    test "returns the schema, or a ValidationError in place of an exception" do
      assert {:ok, %Options{} = schema} = Options.new(a: [type: :integer])
      assert Options.new(schema) == {:ok, schema}
      assert {:error, %ValidationError{keys_path: [:a]}} = Options.new(a: [type: :no])
      assert {:error, %ValidationError{}} = Options.new(:schema)
    end
  end

  # A struct of Spark.Options, as a driver gives it that depends on Spark.
  defp spark(schema), do: %{__struct__: Spark.Options, schema: schema}

  describe "a %Spark.Options{}" do
    test "is accepted wherever a schema is" do
      schema = spark(a: [type: :integer, default: 1], b: [type: :string, doc: "Text."])
      assert Options.validate([b: "x"], schema) == {:ok, [a: 1, b: "x"]}
      assert Options.validate!([a: 2], schema) == [a: 2]
      assert {:error, %ValidationError{key: :b, value: 1}} = Options.validate([b: 1], schema)
      assert {:ok, %Options{schema: checked}} = Options.new(schema)
      assert checked[:a][:default] == 1
      assert Options.new!(schema) == %Options{schema: checked}
      assert Options.docs(schema) == Options.docs(schema.schema)
      assert Options.merge(schema, spark(c: [])) == schema.schema ++ [c: []]
    end

    test "is refused when its schema is wrong" do
      assert_raise ArgumentError, ~r/unknown type :no/, fn ->
        Options.validate([], spark(a: [type: :no]))
      end
    end

    test "is the schema of a driver and of a payload" do
      schema = spark(a: [type: :float, required: true])

      defmodule Driver do
        use BB.Sensor, options_schema: %{__struct__: Spark.Options, schema: [a: [type: :float]]}

        @impl BB.Sensor
        def init(opts), do: {:ok, opts}
      end

      assert %Options{schema: [a: [_ | _]]} = Driver.options_schema()

      defmodule Payload do
        defstruct [:a]
        use BB.Message, schema: %{__struct__: Spark.Options, schema: [a: [type: :float]]}
      end

      assert {:ok, %{payload: %{a: 1.0}}} = Payload.new(:frame, a: 1.0)
      assert Options.validate([a: 1.0], schema) == {:ok, [a: 1.0]}
    end

    for {type, good, bad, expected} <- [
          {:fun, quote(do: &is_atom/1), 1, "expected function, got: 1"},
          {{:fun, [:any]}, quote(do: &is_atom/1), 1, "expected function of arity 1, got: 1"},
          {{:fun, [:any], :any}, quote(do: &is_atom/1), 1,
           "expected function of arity 1, got: 1"},
          {:struct, quote(do: 1..2), 1, "expected struct, got: 1"},
          {:regex, quote(do: Regex.compile!("a")), "a", "expected Regex, got: \"a\""},
          {{:one_of, [:a, :b]}, :a, :c, "expected one of [:a, :b], got: :c"},
          {{:tagged_tuple, :each, :integer}, {:each, 1}, {:all, 1}, "expected :each, got: :all"},
          {{:mfa_or_fun, 1}, quote(do: {String, :upcase, []}), 1,
           "expected tuple {mod, fun, args}, got: 1"},
          {{:spark_behaviour, Greeter}, {English, [loud: true]}, String,
           "expected module that implements #{inspect(Greeter)}, got: String"}
        ] do
      test "may have the type #{inspect(type)}" do
        type = unquote(Macro.escape(type))
        good = unquote(good)
        assert validate(type, good) == {:ok, [k: good]}
        assert message(type, unquote(Macro.escape(bad))) =~ unquote(expected)
      end
    end

    test "may have types that accept any value" do
      for type <- [:literal, :quoted], do: assert(validate(type, {:a, 1}) == {:ok, [k: {:a, 1}]})

      assert validate({:spark_behaviour, Greeter, Builtins}, English) == {:ok, [k: English]}
    end
  end

  describe "merge" do
    test "puts the options of the right schema in the place of those of the left" do
      left = [a: [type: :integer], b: [type: :atom]]
      assert Options.merge(left, b: [type: :float]) == [a: [type: :integer], b: [type: :float]]
      merged = Options.merge(Options.new!(left), [c: [doc: "More."]], "Others")
      assert Keyword.keys(merged) == [:a, :b, :c]
      assert merged[:c] == [subsection: "Others", doc: "More."]
      assert Options.validate([a: 1, c: 2], merged) == {:ok, [a: 1, c: 2]}
      assert Options.docs(merged) =~ "\n\n### Others\n\n  * `:c` - More.\n\n"
    end
  end

  describe "a deprecated option" do
    test "works, and prints a warning with the remedy" do
      schema = [a: [type: :integer, deprecated: "use :b"], b: [type: :integer]]
      warning = capture_io(:stderr, fn -> assert {:ok, _} = Options.validate([a: 1], schema) end)
      assert warning =~ "option :a is deprecated; use :b"
      assert capture_io(:stderr, fn -> Options.validate([b: 1], schema) end) == ""
      assert Options.docs(schema) =~ "* `:a` (`t:integer/0`) - Deprecated: use :b"
    end

    test "that is private is not in the docs" do
      assert Options.docs(a: [private?: true]) == ""
    end
  end

  describe "docs" do
    test "tell type, whether it is required, text and default, and nest" do
      docs =
        Options.docs(
          bus: [type: :string, required: true, doc: "The bus's name."],
          filter: [
            type: :keyword_list,
            doc: "First.\n\nSecond.",
            default: [],
            keys: [size: [type: {:list, :float}]]
          ],
          secret: [doc: false],
          kind: [type: {:in, [:a]}, type_doc: "`:a`"]
        )

      assert docs == """
               * `:bus` (`t:String.t/0`) - Required. The bus's name.

               * `:filter` (`t:keyword/0`) - First.

                 Second.

                 The default value is `[]`.

                 * `:size` (list of `t:float/0`)

               * `:kind` (`:a`)

             """
    end
  end

  property "what is valid stays as it is when it is checked again" do
    schema =
      Options.new!(a: [type: :integer, default: 1], b: [type: {:or, [:atom, :float]}], c: [])

    forall options <- list({oneof([:a, :b, :c, :d]), oneof([integer(), float(), atom()])}) do
      case Options.validate(options, schema) do
        {:ok, valid} -> Options.validate(valid, schema) == {:ok, valid}
        {:error, error} -> is_binary(Exception.message(error))
      end
    end
  end
end
