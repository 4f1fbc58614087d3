defmodule BB.Robot.UnitsTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Unit, only: :sigils

  alias BB.Robot.Units
  alias BB.Unit

  doctest BB.Robot.Units

  @conversions [
    {:to_meters, ~u(100 centimeter), 1.0},
    {:to_radians, ~u(180 degree), 3.141592653589793},
    {:to_kilograms, ~u(1000 gram), 1.0},
    {:to_kilogram_square_meters, ~u(1000 gram_square_meter), 1.0},
    {:to_newtons, ~u(2 kilonewton), 2000.0},
    {:to_newton_meters, ~u(100 newton_centimeter), 1.0},
    {:to_meters_per_second, ~u(36 kilometer_per_hour), 10.0},
    {:to_radians_per_second, ~u(180 degree_per_second), :math.pi()},
    {:to_meters_per_square_second, ~u(250 centimeter_per_square_second), 2.5},
    {:to_radians_per_square_second, ~u(180 degree_per_square_second), :math.pi()},
    {:to_linear_damping, ~u(3 newton_second_per_millimeter), 3000.0},
    {:to_rotational_damping, ~u(1 newton_meter_second_per_degree), 57.29577951308232}
  ]

  for {function, unit, float} <- @conversions do
    test "#{function} returns a float in SI" do
      or_nil = :"#{unquote(function)}_or_nil"
      unit = unquote(Macro.escape(unit))
      assert apply(Units, unquote(function), [unit]) === unquote(float)
      assert apply(Units, or_nil, [unit]) === unquote(float)
      assert apply(Units, or_nil, [nil]) == nil
    end

    test "#{function} takes quantities of its kind alone" do
      function = unquote(function)

      for other <- [nil, 1.0, "1 meter", :meter, %{name: "meter", value: 1}],
          do: assert_raise(FunctionClauseError, fn -> apply(Units, function, [other]) end)

      assert_raise ArgumentError, ~r/^cannot convert 1 second to /, fn ->
        apply(Units, function, [~u(1 second)])
      end
    end
  end

  test "to_newton is to_newtons" do
    assert Units.to_newton(~u(2 kilonewton)) === 2000.0
    assert_raise FunctionClauseError, fn -> Units.to_newton(nil) end
    refute function_exported?(Units, :to_newton_or_nil, 1)
  end

  test "extract_float converts nothing" do
    assert Units.extract_float(~u(5 kilometer)) === 5.0
    assert Units.extract_float(~u(2.5 kilometer)) === 2.5
    assert_raise FunctionClauseError, fn -> Units.extract_float(5) end
  end

  property "a length is the same float whatever its unit" do
    forall {value, name} <- {float(), oneof([:meter, :inch, :millimeter])} do
      unit = Unit.new!(value, name)
      Units.to_meters(unit) === Unit.to_si(unit) and Units.extract_float(unit) === value
    end
  end
end
