defmodule BB.MessageTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Math.{Covariance3, Quaternion, Vec3}
  alias BB.Message
  alias BB.Message.Sensor.{Imu, Status}
  alias BB.Options.ValidationError

  doctest BB.Message

  defmodule Mixed do
    defstruct [
      :float,
      :value,
      :rest,
      :choice,
      :either,
      :list,
      :nested,
      :pair,
      :struct,
      :custom,
      :wrapped,
      :keywords,
      :map,
      :anything,
      :untouched,
      plain: :struct_default,
      atom: :a
    ]

    use BB.Message,
      schema: [
        float: [type: :float, required: true],
        value: [type: :integer],
        rest: [type: :non_neg_integer, default: 3],
        choice: [type: {:in, [:a, nil, 1, "s"]}, default: :a],
        either: [type: {:or, [:float, nil, {:list, :boolean}]}],
        list: [type: {:list, {:or, [:float, {:tuple, [:atom, :pos_integer]}]}}, default: []],
        nested: [type: {:list, {:list, :string}}],
        pair: [type: {:tuple, [:number, {:list, :atom}]}],
        struct: [type: {:or, [{:struct, Vec3}, {:literal, 0}]}],
        custom: [type: {:custom, BB.MessageTest, :double, [2]}],
        wrapped: [type: {:wrap_list, :atom}],
        keywords: [
          type: :keyword_list,
          keys: [a: [type: :integer, default: 1], b: [type: :atom]]
        ],
        map: [type: {:map, :atom, :integer}],
        anything: [type: :any],
        plain: [type: :atom],
        atom: [type: :atom, required: true]
      ]
  end

  def double(value, factor) when is_integer(value), do: {:ok, value * factor}
  def double(value, _factor), do: {:error, "expected a whole number, got: #{inspect(value)}"}

  defp imu_attrs do
    [
      orientation: Quaternion.identity(),
      angular_velocity: Vec3.zero(),
      linear_acceleration: Vec3.new(0, 0, 9.81)
    ]
  end

  defp compile(body) do
    name = Module.concat(__MODULE__, "Compiled#{System.unique_integer([:positive])}")
    Module.create(name, body, __ENV__)
  end

  describe "the envelope" do
    test "holds the times of its making, the node, the frame and the payload" do
      before = {System.monotonic_time(:nanosecond), System.system_time(:nanosecond)}
      assert {:ok, %Message{} = message} = Imu.new(:imu, imu_attrs())
      now = {System.monotonic_time(:nanosecond), System.system_time(:nanosecond)}

      assert message.monotonic_time in elem(before, 0)..elem(now, 0)
      assert_in_delta message.wall_time, elem(now, 1), 1_000_000_000
      assert message.node == node()
      assert message.frame_id == :imu

      assert %Imu{linear_acceleration: %Vec3{z: 9.81}, orientation_covariance: nil} =
               message.payload
    end

    test "has no robot until it is published" do
      assert Message.new!(Imu, :imu, imu_attrs()).robot == nil
    end

    test "takes the times of an earlier measurement" do
      message = Message.new!(Imu, :imu, imu_attrs(), monotonic_time: 5, wall_time: 7)
      assert {message.monotonic_time, message.wall_time} == {5, 7}
    end

    test "finds the other time of a moment that is given by one" do
      now = System.monotonic_time(:nanosecond)
      by_monotonic = Message.new!(Imu, :imu, imu_attrs(), monotonic_time: now)
      assert_in_delta by_monotonic.wall_time, System.system_time(:nanosecond), 1_000_000_000

      by_wall = Message.new!(Imu, :imu, imu_attrs(), wall_time: by_monotonic.wall_time)
      assert_in_delta by_wall.monotonic_time, now, 1_000_000_000
    end

    test "refuses other times, with the names of those it takes" do
      for times <- [[time: 1], [wall_time: 1.0], [monotonic_time: nil, wall_time: 1]] do
        assert_raise ArgumentError, ~r/:monotonic_time and :wall_time.*got: \[/, fn ->
          Message.new(Imu, :imu, imu_attrs(), times)
        end
      end
    end

    test "has a frame_id that is an atom, and attributes that are a list or a map" do
      for {frame_id, attrs} <- [
            {"imu", imu_attrs()},
            {1, imu_attrs()},
            {:imu, "attrs"},
            {:imu, nil}
          ],
          make <- [&Imu.new/2, &Message.new(Imu, &1, &2), &Message.new!(Imu, &1, &2)],
          do: assert_raise(FunctionClauseError, fn -> make.(frame_id, attrs) end)
    end

    test "is a struct whose fields may all be left out" do
      assert %Message{} == %Message{
               monotonic_time: nil,
               wall_time: nil,
               node: nil,
               frame_id: nil,
               payload: nil,
               robot: nil,
               arm_epoch: nil
             }

      assert Message.new!(Imu, :imu, imu_attrs()).arm_epoch == nil
    end
  end

  describe "new" do
    test "returns the validation error" do
      assert {:error, %ValidationError{key: :linear_acceleration}} =
               Message.new(Imu, :imu, Keyword.delete(imu_attrs(), :linear_acceleration))
    end

    test "new! raises it" do
      assert_raise ValidationError, ~r/unknown options \[:x\]/, fn ->
        Message.new!(Imu, :imu, [x: 1] ++ imu_attrs())
      end
    end

    test "refuses a module that is no payload" do
      for module <- [String, Vec3, NoSuchModule, "Imu"] do
        assert_raise ArgumentError, ~r/^expected a payload module, got: /, fn ->
          Message.new(module, :imu, [])
        end

        assert_raise ArgumentError, ~r/^expected a payload module, got: /, fn ->
          Message.schema(module)
        end
      end
    end

    test "float fields reject integers" do
      assert {:error, error} = Mixed.new(:frame, float: 1, atom: :a)
      assert Exception.message(error) == "invalid value for :float option: expected float, got: 1"
    end

    test "takes a map of attributes" do
      assert {:ok, %{payload: %Mixed{float: 1.0}}} = Mixed.new(:frame, %{float: 1.0, atom: :b})
    end

    test "fills in the schema's defaults, then the struct's" do
      {:ok, message} = Mixed.new(:frame, float: 1.0, atom: :b)
      assert %Mixed{rest: 3, choice: :a, list: [], plain: :struct_default} = message.payload
    end
  end

  describe "use BB.Message" do
    test "gives the schema" do
      assert %BB.Options{} = Imu.schema()
      assert Message.schema(Imu) == Imu.schema()
      assert Message.schema(Message.new!(Imu, :imu, imu_attrs())) == Imu.schema()
      assert {:ok, _} = BB.Options.validate(imu_attrs(), Imu.schema())
    end

    test "gives every payload the behaviour BB.Message" do
      assert BB.Message.behaviour_info(:callbacks) == [schema: 0]
      {:ok, modules} = :application.get_key(:ganglion, :modules)

      payloads =
        for module <- [Mixed | modules],
            Code.ensure_loaded?(module) and function_exported?(module, :__payload__, 1),
            do: module

      assert length(payloads) > 20

      for module <- payloads,
          do: assert(BB.Message in List.flatten(module.module_info(:attributes)[:behaviour]))
    end

    # The options of a controller that takes the modules of its input and its output.
    test "makes a payload module an option's value, whose fields can be read" do
      schema = BB.Options.new!(input: [type: {:behaviour, BB.Message}, required: true])
      assert {:ok, input: Imu} = BB.Options.validate([input: Imu], schema)
      assert Imu.schema().schema[:orientation][:type] == {:struct, Quaternion}

      for module <- [String, Vec3, NoSuchModule, nil],
          do: assert({:error, %{key: :input}} = BB.Options.validate([input: module], schema))
    end

    test "is not needed by a struct that has the behaviour" do
      {:module, module, _, _} =
        compile(
          quote do
            @behaviour BB.Message
            defstruct [:rate, wet: false]
            @impl BB.Message
            def schema, do: BB.Options.new!(rate: [type: :float, required: true])
          end
        )

      assert %Message{payload: payload} = Message.new!(module, :roof, rate: 1.0)
      assert payload == struct!(module, rate: 1.0)
      assert {:error, %ValidationError{key: :rate}} = Message.new(module, :roof, rate: 1)
      assert Message.schema(module) == module.schema()
    end

    test "refuses keys that the struct does not have, when compiled" do
      assert_raise CompileError,
                   ~r/unknown fields \[:speed\] in the schema of .*, the fields of its struct are: \[:rate\]/,
                   fn ->
                     compile(
                       quote do
                         defstruct [:rate]
                         use BB.Message, schema: [rate: [type: :float], speed: [type: :float]]
                       end
                     )
                   end
    end

    test "refuses to come before defstruct" do
      assert_raise CompileError, ~r/put defstruct before use BB.Message/, fn ->
        compile(quote do: use(BB.Message, schema: []))
      end
    end

    test "refuses a schema that is wrong" do
      assert_raise ArgumentError, ~r/unknown type :flaot/, fn ->
        compile(
          quote do
            defstruct [:rate]
            use BB.Message, schema: [rate: [type: :flaot]]
          end
        )
      end
    end

    test "takes a schema and nothing else" do
      for opts <- [[], [shema: []], [schema: [], rate: 1]] do
        error =
          assert_raise ArgumentError, fn ->
            compile(
              quote do
                defstruct [:rate]
                use BB.Message, unquote(opts)
              end
            )
          end

        assert error.message ==
                 "expected use BB.Message with schema: alone, got: #{inspect(opts)}"
      end
    end

    test "works with enforced keys" do
      {:module, module, _, _} =
        compile(
          quote do
            @enforce_keys [:rate]
            defstruct [:rate, :note]
            use BB.Message, schema: [rate: [type: :float, required: true], note: [type: :string]]
          end
        )

      assert {:ok, %{payload: %{rate: 1.0, note: nil}}} = module.new(:frame, rate: 1.0)
    end
  end

  defp value do
    oneof([
      float(),
      integer(-2, 3),
      boolean(),
      nil,
      atom(),
      "s",
      list(oneof([boolean(), float(), {:a, integer(0, 2)}, "s", ["s"], :a])),
      {oneof([1, 1.0, :a]), list(atom())},
      Vec3.zero(),
      [a: integer(0, 1)],
      [b: oneof([:b, 1])],
      [c: 1],
      %{a: 1},
      [1 | 2]
    ])
  end

  defp fitting do
    [
      {:float, float()},
      {:value, integer()},
      {:choice, oneof([:a, nil, 1, "s"])},
      {:either, oneof([float(), nil, list(boolean())])},
      {:list, list(oneof([float(), {atom(), pos_integer()}]))},
      {:nested, list(list("s"))},
      {:pair, {number(), list(atom())}},
      {:struct, oneof([Vec3.zero(), 0])},
      {:custom, integer()},
      {:wrapped, oneof([:a, [:a, :b], nil])},
      {:keywords, oneof([[], [a: integer()], [b: atom()]])},
      {:map, oneof([%{}, %{a: integer()}])},
      {:atom, atom()}
    ]
  end

  # Values just outside of the valid ones.
  defp near do
    [
      {:float, oneof([0.0, 0])},
      {:rest, integer(-1, 1)},
      {:choice, oneof([1, 1.0, :b])},
      {:either, oneof([list(oneof([true, nil])), 0])},
      {:list, list(oneof([0.0, {:a, integer(0, 2)}, {:a, 1, 1}]))},
      {:nested, list(oneof([["s"], ["s", :s]]))},
      {:pair, oneof([{1, [:a, "a"]}, {1, :a}, {nil, []}, {1, [], []}])},
      {:struct, oneof([0.0, 0, %{__struct__: :other}])},
      {:keywords, oneof([[a: 1], [a: 1, a: 2], [a: :a]])}
    ]
  end

  # Mostly each required key once, in any order, as from a driver; sometimes any attributes.
  defp attrs do
    keys = Keyword.keys(Mixed.schema().schema)
    random = {oneof([:untouched | keys]), value()}
    some = list(oneof(fitting() ++ near() ++ [random]))
    required = fixed_list([{:float, float()}, {:atom, atom()}])

    frequency([
      {8,
       map({some, required}, fn {some, required} ->
         Enum.uniq_by(some ++ required, &elem(&1, 0))
       end)},
      {1, map({some, required}, fn {some, required} -> some ++ required end)},
      {1, some}
    ])
  end

  property "the compiled constructor and BB.Options agree", numtests: 2_000 do
    forall attrs <- attrs() do
      expected =
        with {:ok, valid} <- BB.Options.validate(attrs, Mixed.schema()),
             do: {:ok, struct!(Mixed, valid)}

      made = with {:ok, message} <- Mixed.new(:frame, attrs), do: {:ok, message.payload}
      assert made === expected
      true
    end
  end

  test "what is valid never walks the schema" do
    attrs = [
      float: 1.0,
      value: 1,
      choice: nil,
      either: [true, false],
      list: [1.0, {:a, 1}],
      nested: [["s"], []],
      pair: {1, [:a]},
      struct: Vec3.zero(),
      custom: 1,
      wrapped: :a,
      map: %{a: 1},
      anything: self(),
      plain: :a,
      atom: :a
    ]

    assert validated(fn -> Mixed.new(:frame, Enum.shuffle(attrs)) end) == 0

    assert validated(fn -> Mixed.new(:frame, float: 1.0, atom: :a, either: 1.0, struct: 0) end) ==
             0

    assert validated(fn -> Mixed.new(:frame, float: 1) end) == 1
  end

  # Counts the calls of BB.Options by this process while `fun` runs.
  defp validated(fun) do
    :erlang.trace_pattern({BB.Options, :validate, 2}, true, [:local])
    :erlang.trace(self(), true, [:call, {:tracer, tracer = spawn_link(&count/0)}])
    fun.()
    :erlang.trace(self(), false, [:call])
    ref = :erlang.trace_delivered(self())
    assert_receive {:trace_delivered, _, ^ref}
    send(tracer, {:count, self()})
    assert_receive {:count, count}
    count
  end

  defp count(n \\ 0) do
    receive do
      {:trace, _, :call, _} -> count(n + 1)
      {:count, to} -> send(to, {:count, n})
    end
  end

  describe "Imu" do
    test "takes covariances" do
      covariance = Covariance3.unavailable()
      message = Message.new!(Imu, :imu, [orientation_covariance: covariance] ++ imu_attrs())
      assert message.payload.orientation_covariance == covariance
    end
  end

  describe "Status" do
    test "needs nothing but a state" do
      assert %Status{state: :up, reason: nil, restarts: 0, retry_in_ms: nil} =
               Message.new!(Status, :imu, state: :up).payload
    end

    test "names the states" do
      assert_raise ValidationError,
                   "invalid value for :state option: expected one of [:up, :backoff, :stale, :ignored], got: :gone",
                   fn -> Message.new!(Status, :imu, state: :gone) end
    end
  end
end
