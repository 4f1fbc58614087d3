defmodule BB.Parameter.SchemaTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Robot
  import BB.Unit, only: :sigils

  alias BB.Options
  alias BB.Parameter.{Schema, Type}

  doctest BB.Parameter.Schema

  describe "build_nested_schema" do
    test "of no parameters is empty" do
      assert Schema.build_nested_schema([]) == []
    end

    test "nests by path, sorts the names of each level, and keeps the rest of a description" do
      flat = [
        {[:motion, :speed], [type: :float, doc: "Fast.", default: 1.0, required: true]},
        {[:zero], [type: :integer, default: 0]},
        {[:motion, :limits, :upper], [type: :float]},
        {[:motion, :limits, :lower], [type: :float]},
        {[:debug], [type: :boolean]}
      ]

      nested = Schema.build_nested_schema(flat)

      assert nested == [
               debug: [type: :boolean],
               motion: [
                 type: :keyword_list,
                 keys: [
                   limits: [
                     type: :keyword_list,
                     keys: [lower: [type: :float], upper: [type: :float]]
                   ],
                   speed: [type: :float, doc: "Fast."]
                 ]
               ],
               zero: [type: :integer]
             ]

      assert Options.validate([motion: [limits: [lower: 1.0]]], nested) ==
               {:ok, [motion: [limits: [lower: 1.0]]]}

      assert {:error, error} = Options.validate([motion: [limits: [lower: 1]]], nested)
      assert error.keys_path == [:motion, :limits]
    end

    test "refuses a parameter above another" do
      assert_raise ArgumentError,
                   "expected one parameter or a group at [:arm], got both",
                   fn -> Schema.build_nested_schema([{[:arm], []}, {[:arm, :gain], []}]) end
    end
  end

  describe "flatten_params" do
    test "takes a keyword list with elements as a level, and anything else as a value" do
      assert Schema.flatten_params([]) == []

      assert Schema.flatten_params(a: [b: [c: 1], d: []], e: [1], f: %{g: 1}, h: nil) == [
               {[:a, :b, :c], 1},
               {[:a, :d], []},
               {[:e], [1]},
               {[:f], %{g: 1}},
               {[:h], nil}
             ]
    end
  end

  describe "a robot's module" do
    test "has the flat schema of its parameters, with the bounds in the types, and the defaults" do
      robot =
        robot do
          parameters do
            param :debug, type: :boolean, default: false, doc: "Say more."
            param :note, type: :string

            group :motion do
              param :speed, type: :float, default: 0.5, min: 0.0, max: 1.0
              param :gain, type: :float

              group :arm do
                param :reach, type: {:unit, :meter}, default: ~u(50 centimeter)
                param :low, type: {:unit, :meter}, min: ~u(1 centimeter)
              end
            end

            param :filter, type: {:keyword_list, [size: [type: :pos_integer]]}
          end
        end

      bounded = {:custom, Type, :validate_bounds, [[type: :float, min: 0.0, max: 1.0]]}
      unit = &{:custom, BB.Unit.Option, :validate, [&1]}

      assert robot.__bb_parameter_schema__() == [
               {[:debug], [type: :boolean, doc: "Say more.", default: false]},
               {[:note], [type: :string]},
               {[:motion, :speed], [type: bounded, default: 0.5]},
               {[:motion, :gain], [type: :float]},
               {[:motion, :arm, :reach],
                [type: unit.(compatible: :meter), default: ~u(0.5 meter)]},
               {[:motion, :arm, :low], [type: unit.(compatible: :meter, min: ~u(1 centimeter))]},
               {[:filter], [type: :keyword_list, keys: [size: [type: :pos_integer]]]}
             ]

      assert robot.__bb_default_parameters__() == [
               {[:debug], false},
               {[:motion, :speed], 0.5},
               {[:motion, :arm, :reach], ~u(0.5 meter)}
             ]
    end

    test "without parameters has neither" do
      robot = create(quote(do: settings(name: :bare)))
      assert robot.__bb_parameter_schema__() == []
      assert robot.__bb_default_parameters__() == []
    end

    test "has a schema that a nested one can be built of, for values of params:" do
      robot =
        robot do
          parameters do
            group :arm do
              param :gain, type: :float, default: 1.0, max: 2.0
            end
          end
        end

      nested = Schema.build_nested_schema(robot.__bb_parameter_schema__())
      assert Options.validate([arm: [gain: 1.5]], nested) == {:ok, [arm: [gain: 1.5]]}
      assert Options.validate([], nested) == {:ok, []}
      assert {:error, error} = Options.validate([arm: [gain: 2.5]], nested)

      assert Exception.message(error) ==
               "invalid value for :gain option: expected value to be at most 2.0, got: 2.5 (in options [:arm])"
    end
  end

  # Trees of groups and values, as nested keyword lists

  @names ~w(a b c d)a

  defp tree(0), do: a_value()

  defp tree(depth) do
    frequency([
      {2, a_value()},
      {1, map(list({name(), :proper_types.lazy(fn -> tree(depth - 1) end)}), &unique/1)}
    ])
  end

  defp name, do: oneof(Enum.map(@names, &exactly/1))
  defp a_value, do: oneof([integer(), boolean(), float(), exactly([])])
  defp unique(pairs), do: Enum.uniq_by(pairs, &elem(&1, 0))
  defp params, do: map(list({name(), tree(3)}), &unique/1)

  defp sort(params) when is_list(params),
    do: params |> Enum.map(fn {name, value} -> {name, sort(value)} end) |> Enum.sort()

  defp sort(value), do: value

  defp nest(flat), do: Enum.reduce(flat, [], fn {path, value}, into -> put(into, path, value) end)
  defp put(into, [name], value), do: into ++ [{name, value}]

  defp put(into, [name | path], value),
    do: Keyword.update(into, name, put([], path, value), &put(&1, path, value))

  property "flattened parameters nest to the same parameters" do
    forall params <- params() do
      nest(Schema.flatten_params(params)) == params
    end
  end

  property "a nested schema accepts exactly the parameters that it was built of" do
    forall params <- params() do
      flat = Schema.flatten_params(params)
      specs = for {path, value} <- flat, do: {path, [type: {:literal, value}, default: :no]}
      schema = Schema.build_nested_schema(specs)
      assert {:ok, valid} = Options.validate(params, schema)
      assert sort(valid) == sort(params)

      for {path, _value} <- flat do
        wrong = nest(for {at, value} <- flat, do: {at, if(at == path, do: :wrong, else: value)})
        assert {:error, error} = Options.validate(wrong, schema)
        assert error.keys_path ++ [error.key] == path
      end

      flattened = for {path, spec} <- flatten_schema(schema), do: {path, spec[:type]}
      Enum.sort(flattened) == Enum.sort(for({path, spec} <- specs, do: {path, spec[:type]}))
    end
  end

  # Independent of flatten_params: a level has :keys.
  defp flatten_schema(schema) do
    Enum.flat_map(schema, fn {name, spec} ->
      case spec[:keys] do
        nil -> [{[name], spec}]
        keys -> for {path, spec} <- flatten_schema(keys), do: {[name | path], spec}
      end
    end)
  end
end
