defmodule BB.Parameter.TypeTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Unit, only: :sigils
  import BB.Unit.Option, only: [unit_type: 1]

  alias BB.Options
  alias BB.Parameter.Type

  doctest BB.Parameter.Type

  def even(value) when is_integer(value) and rem(value, 2) == 0, do: {:ok, value}
  def even(value), do: {:error, "expected an even number, got: #{inspect(value)}"}

  # A value, or the message about the option :k.
  defp cast(type, value, bounds \\ []) do
    case Type.cast(type, bounds[:min], bounds[:max], value, :k) do
      {:ok, value} -> {:ok, value}
      {:error, error} -> {:error, Exception.message(error)}
    end
  end

  describe "a type" do
    test "is one of BB.Options or a unit, alone and inside another type" do
      for {type, good, bad} <- [
            {:float, 1.0, 1},
            {:integer, 1, 1.0},
            {:boolean, true, :yes},
            {:string, "a", :a},
            {:atom, :a, "a"},
            {:pos_integer, 1, 0},
            {:non_neg_integer, 0, -1},
            {:number, 1.5, "1"},
            {:module, String, nil},
            {nil, nil, false},
            {:keyword_list, [a: 1], [1]},
            {{:keyword_list, [gain: [type: :float]]}, [gain: 1.0], [gain: 1]},
            {:map, %{a: 1}, [a: 1]},
            {:timeout, :infinity, -1},
            {{:literal, :infinity}, :infinity, :never},
            {{:struct, Range}, 1..2, [1, 2]},
            {{:custom, __MODULE__, :even, []}, 2, 1},
            {{:tuple, [:atom, {:unit, :meter}]}, {:a, ~u(1 meter)}, {:a, 1}},
            {{:map, :atom, {:unit, :meter}}, %{a: ~u(1 meter)}, %{a: 1}},
            {{:wrap_list, {:unit, :meter}}, [~u(1 meter)], [1]},
            {{:unit, :hertz}, ~u(1 hertz), 1},
            {{:unit, "newton-meter"}, ~u(1 newton_meter), ~u(1 newton)},
            {{:in, [:slow, :fast]}, :slow, :medium},
            {{:in, 1..10}, 10, 11},
            {{:in, MapSet.new([1])}, 1, 2},
            {{:or, [:integer, {:unit, :meter}]}, ~u(1 meter), "1"},
            {{:or, [:non_neg_integer, nil]}, nil, -1},
            {{:list, {:or, [:atom, :string]}}, [:a, "b"], [:a, 1]}
          ] do
        assert Type.validate(type) == {:ok, type}
        assert cast(type, good) == {:ok, good}
        assert {:error, message} = cast(type, bad)
        assert message =~ ~r/:k option|in options \[:k\]/
      end
    end

    test "is nothing else" do
      for type <- [
            :flaot,
            {:in, []},
            {:in, 5},
            {:or, []},
            {:or, :float},
            {:or, [:float, :no]},
            {:list, :x},
            {:unit, :metre},
            {:unit, 1},
            {:unit, nil},
            {:keyword_list, [gain: [type: :no]]},
            "float"
          ] do
        assert {:error, reason} = Type.validate(type)
        assert is_binary(reason)
        assert Type.option_type(type, nil, nil) == {:error, reason}
      end
    end

    test "calls functions outside of this library if one of its parts does" do
      for type <- [
            {:custom, __MODULE__, :even, []},
            {:list, {:or, [nil, {:custom, __MODULE__, :even, []}]}},
            {:keyword_list, [a: [type: {:custom, __MODULE__, :even, []}]]},
            {:in, MapSet.new([1])}
          ],
          do: assert(Type.foreign?(type))

      {:ok, bounded} = Type.option_type(:float, 0, 1)
      {:ok, unit} = Type.option_type({:unit, :meter}, nil, nil)

      for type <- [:float, {:unit, :meter}, bounded, unit, {:in, [1]}, {:in, 1..2}],
          do: refute(Type.foreign?(type))
    end
  end

  describe "an option type" do
    test "without bounds is the type itself" do
      for type <- [:float, :string, {:in, [1]}, {:or, [:pos_integer, nil]}, {:list, :atom}],
          do: assert(Type.option_type(type, nil, nil) == {:ok, type})
    end

    test "of a unit keeps the unit of a value, which has to be within the bounds" do
      {:ok, type} = Type.option_type({:unit, :meter}, ~u(1 meter), ~u(2 kilometer))
      schema = Options.new!(k: [type: type])
      assert type == unit_type(compatible: :meter, min: ~u(1 meter), max: ~u(2 kilometer))
      assert Options.validate([k: ~u(100 centimeter)], schema) == {:ok, [k: ~u(100 centimeter)]}
      assert {:error, _} = Options.validate([k: ~u(99 centimeter)], schema)
      assert {:error, _} = Options.validate([k: ~u(1 second)], schema)
    end

    test "of a unit is that of BB.Unit.Option, with the bounds that are given" do
      assert Type.option_type({:unit, :meter}, nil, nil) ==
               {:ok, {:custom, BB.Unit.Option, :validate, [[compatible: :meter]]}}

      assert Type.option_type({:unit, :meter}, ~u(1 meter), ~u(2 kilometer)) ==
               {:ok,
                {:custom, BB.Unit.Option, :validate,
                 [[compatible: :meter, min: ~u(1 meter), max: ~u(2 kilometer)]]}}

      assert Type.option_type({:or, [{:unit, :meter}, nil]}, nil, nil) ==
               {:ok, {:or, [{:custom, BB.Unit.Option, :validate, [[compatible: :meter]]}, nil]}}
    end

    test "of a number checks the bounds, of a list those of its elements" do
      assert {:ok, type} = Type.option_type(:integer, 1, nil)

      assert type ==
               {:custom, Type, :validate_bounds, [[type: :integer, min: 1, max: nil]]}

      assert Options.validate([k: 1], k: [type: type]) == {:ok, [k: 1]}
      assert {:error, error} = Options.validate([k: 0], k: [type: type])

      assert Exception.message(error) ==
               "invalid value for :k option: expected value to be at least 1, got: 0"

      assert Type.option_type({:list, :integer}, 1, nil) == {:ok, {:list, type}}
    end

    for {type, min, max, reason} <- [
          {:float, "0", nil, "`min` must be a number, got: \"0\""},
          {:float, nil, quote(do: ~u(1 meter)), "`max` must be a number, got: ~u(1 meter)"},
          {{:unit, :meter}, nil, 1, "`max` must be a `BB.Unit` compatible with `meter`, got: 1"},
          {{:unit, :meter}, nil, quote(do: ~u(1 second)),
           "`max` must be compatible with `meter`, got: ~u(1 second)"},
          {:boolean, 1, nil,
           "`min` and `max` are only supported for numeric parameter types, " <>
             "got: :boolean; remove them"},
          {{:in, [1, 2]}, 1, nil, "only supported for numeric parameter types"},
          {:integer, 2, 1, "`min` must not be greater than `max`, got: 2 and 1; swap them"},
          {{:unit, :meter}, quote(do: ~u(1 kilometer)), quote(do: ~u(999 meter)),
           "`min` must not be greater than `max`, got: ~u(1 kilometer) and ~u(999 meter)"}
        ] do
      test "of #{inspect(type)} with #{Macro.to_string([min, max])} is refused" do
        type = unquote(Macro.escape(type))
        assert {:error, reason} = Type.option_type(type, unquote(min), unquote(max))
        assert reason =~ unquote(reason)
      end
    end

    test "is undone by describe, and other terms have no bounds" do
      for {type, min, max} <- [
            {:float, 0.0, 1.0},
            {:integer, nil, 3},
            {:pos_integer, 3, nil},
            {{:unit, :meter}, nil, nil},
            {{:unit, :meter}, ~u(1 meter), nil},
            {{:list, :integer}, 0, nil},
            {{:list, {:unit, :meter}}, nil, ~u(1 meter)},
            {:string, nil, nil},
            {nil, nil, nil},
            {{:or, [:float, nil]}, nil, nil}
          ] do
        {:ok, option_type} = Type.option_type(type, min, max)
        assert Type.describe(option_type) == {type, min, max}
      end

      other = {:custom, __MODULE__, :even, []}
      assert Type.describe(other) == {other, nil, nil}
      assert Type.describe({:list, other}) == {{:list, other}, nil, nil}
      no_unit = {:custom, BB.Unit.Option, :validate, [[]]}
      assert Type.describe(no_unit) == {no_unit, nil, nil}
      no_kind = {:custom, BB.Unit.Option, :validate, [[min: ~u(1 meter)]]}
      assert Type.describe(no_kind) == {no_kind, nil, nil}

      one_value = unit_type(compatible: :meter, eq: ~u(1 meter))
      assert Type.describe(one_value) == {{:unit, :meter}, ~u(1 meter), ~u(1 meter)}
      reference = BB.Parameter.Reference.param([:limit])
      followed = unit_type(compatible: :meter, min: ~u(1 meter), max: reference)
      assert Type.describe(followed) == {{:unit, :meter}, ~u(1 meter), nil}
    end
  end

  describe "validate_bounds" do
    test "checks the type, then the bounds, which are inclusive" do
      bounds = &Type.validate_bounds(&1, type: &2, min: &3, max: &4)
      assert bounds.(0.0, :float, 0.0, 1.0) == {:ok, 0.0}
      assert bounds.(1.0, :float, 0.0, 1.0) == {:ok, 1.0}
      assert bounds.(7, :integer, nil, nil) == {:ok, 7}
      assert bounds.(1.5, :integer, 1, 2) == {:error, "expected integer, got: 1.5"}
      assert bounds.(1, :float, 0.0, 1.0) == {:error, "expected float, got: 1"}

      assert bounds.(-0.5, :float, 0.0, 1.0) ==
               {:error, "expected value to be at least 0.0, got: -0.5"}

      assert bounds.(5.0, :float, 0.0, 1.0) ==
               {:error, "expected value to be at most 1.0, got: 5.0"}
    end
  end

  describe "a cast" do
    test "converts a quantity to the unit of the type, also inside another type" do
      assert cast({:unit, :radian}, ~u(180 degree)) == {:ok, BB.Unit.new!(:math.pi(), :radian)}
      assert cast({:list, {:unit, :meter}}, [~u(1 kilometer)]) == {:ok, [~u(1000 meter)]}
      assert cast({:or, [nil, {:unit, :meter}]}, ~u(1 kilometer)) == {:ok, ~u(1000 meter)}

      assert cast(
               {:or, [nil, {:custom, BB.Unit.Option, :validate, [[compatible: :meter]]}]},
               ~u(1 kilometer)
             ) ==
               {:ok, ~u(1000 meter)}

      assert cast({:unit, :hertz}, ~u(1 meter)) ==
               {:error,
                "invalid value for :k option: cannot convert 1 meter to hertz: 1 meter is a length, hertz is a frequency"}

      assert cast({:unit, :hertz}, 100) ==
               {:error,
                "invalid value for :k option: expected a quantity such as ~u(1 hertz), got: 100"}
    end

    test "checks bounds, which are inclusive, and hold for each element of a list" do
      assert cast(:integer, 1, min: 1, max: 1) == {:ok, 1}
      assert {:error, _} = cast(:integer, 0, min: 1)
      assert {:error, _} = cast(:float, 1.5, max: 1)
      assert cast({:unit, :meter}, ~u(100 centimeter), max: ~u(1 meter)) == {:ok, ~u(1 meter)}

      assert cast({:unit, :meter}, ~u(101 centimeter), max: ~u(1 meter)) ==
               {:error,
                "invalid value for :k option: expected value to be at most ~u(1 meter), got: ~u(1.01 meter)"}

      assert cast({:list, :integer}, [1, 2], min: 1) == {:ok, [1, 2]}

      assert cast({:list, :integer}, [1, 0], min: 1) ==
               {:error,
                "invalid list in :k option: invalid value for list element at position 1: expected value to be at least 1, got: 0"}
    end

    test "refuses a reference, which is no value" do
      reference = BB.Parameter.Reference.param([:other])
      assert {:error, message} = cast({:unit, :meter}, reference)
      assert message =~ "expected a quantity such as ~u(1 meter), got: %BB.Parameter.Reference{"
    end
  end

  # Bounds in one unit, values in another

  @lengths [:millimeter, :centimeter, :meter, :kilometer]
  @per_meter %{millimeter: 1000, centimeter: 100, meter: 1, kilometer: {1, 1000}}

  # Whole meters in a unit; only whole kilometers, so that all numbers are integers.
  defp length_of(meters, unit) do
    case @per_meter[unit] do
      {1, divisor} -> BB.Unit.new!(div(meters, divisor), unit)
      factor -> BB.Unit.new!(meters * factor, unit)
    end
  end

  defp kilometers, do: map(integer(-50, 50), &(&1 * 1000))
  defp a_unit, do: oneof(Enum.map(@lengths, &exactly/1))

  property "a quantity is within bounds as its number of meters is, whatever the units" do
    forall {value, a, b, units} <-
             {kilometers(), kilometers(), kilometers(), vector(4, a_unit())} do
      [own, unit, min_unit, max_unit] = units
      {min, max} = {min(a, b), max(a, b)}

      assert {:ok, _} =
               Type.option_type({:unit, own}, length_of(min, min_unit), length_of(max, max_unit))

      result =
        cast({:unit, own}, length_of(value, unit),
          min: length_of(min, min_unit),
          max: length_of(max, max_unit)
        )

      if value >= min and value <= max do
        {:ok, quantity} = result
        assert quantity.name == to_string(own)
        assert BB.Unit.compare(quantity, length_of(value, :meter)) == :eq
      else
        side = if value < min, do: "at least", else: "at most"
        assert {:error, message} = result
        assert message =~ "expected value to be #{side}"
      end
    end
  end

  property "describe undoes option_type for any bounds of numbers" do
    forall {type, a, b} <- {oneof([:integer, :float, :number]), integer(), integer()} do
      {min, max} = {min(a, b), max(a, b)}
      {:ok, option_type} = Type.option_type(type, min, max)
      Type.describe(option_type) == {type, min, max}
    end
  end
end
