defmodule BB.UnitTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Unit, only: :sigils

  alias BB.Unit

  doctest BB.Unit

  defp evaluate(code), do: Code.eval_string("import BB.Unit, only: :sigils\n" <> code)

  describe "the sigil" do
    test "makes a quantity" do
      assert ~u(5 meter_per_second) == %Unit{name: "meter-per-second", value: 5}
      assert ~u(0.1 meter) == %Unit{name: "meter", value: 0.1}
      assert ~u(-90 degree) == %Unit{name: "degree", value: -90}
      assert ~u(1_000 newton-meter) == %Unit{name: "newton-meter", value: 1000}
      assert ~u(1.0e-3 second).value == 0.001
    end

    test "is evaluated when compiled" do
      value = Macro.expand(quote(do: ~u(1 meter)), __ENV__)
      assert {:%{}, _, fields} = value
      assert Enum.sort(fields) == [__struct__: Unit, name: "meter", value: 1]
    end

    test "refuses a unit that does not exist, names it and similar ones" do
      assert_raise CompileError,
                   ~r/unknown unit "milisecond"; did you mean millisecond or /,
                   fn ->
                     evaluate("~u(100 milisecond)")
                   end

      assert_raise CompileError,
                   ~r/unknown unit "metre" in "metre-per-second"; did you mean meter or /,
                   fn ->
                     evaluate("~u(1 metre_per_second)")
                   end

      assert_raise CompileError,
                   ~r/unknown unit "blurb", the units are: .*meter.*, some with SI prefixes/,
                   fn ->
                     evaluate("~u(1 blurb)")
                   end
    end

    test "refuses what is not a number and a unit" do
      for text <- [
            "~u(5)",
            "~u(meter)",
            "~u(five meter)",
            "~u(5meter)",
            "~u()",
            "~u(5 meter now)"
          ] do
        assert_raise CompileError,
                     ~r/expected a number and a unit, such as 5 meter_per_second, got: /,
                     fn ->
                       evaluate(text)
                     end
      end
    end

    test "refuses a unit that is not complete" do
      for name <- ["meter_per", "per", "square", "meter_per_square"] do
        assert_raise CompileError, ~r/expected a complete unit, got: /, fn ->
          evaluate("~u(1 #{name})")
        end
      end
    end

    test "refuses interpolation and modifiers" do
      for text <- ["~u(\#{5} meter)", "~u(5 meter)s"] do
        assert_raise CompileError, ~r/BB.Unit.new!\/2/, fn -> evaluate(text) end
      end
    end
  end

  describe "new" do
    test "takes an atom or a string, with _ or -" do
      expected = {:ok, %Unit{name: "meter-per-second", value: 5}}

      for name <- [:meter_per_second, "meter_per_second", "meter-per-second"],
          do: assert(Unit.new(5, name) == expected)
    end

    test "takes its arguments in either order" do
      assert Unit.new(:meter, 5) == Unit.new(5, :meter)
    end

    test "raises for what is no number or no name" do
      assert_raise ArgumentError, ~r/a number and the name of a unit, got: "5" and :meter/, fn ->
        Unit.new("5", :meter)
      end

      assert_raise ArgumentError,
                   ~r/expected an atom or a string as the name of a unit, got: 5/,
                   fn ->
                     Unit.new(5, 5)
                   end

      assert_raise ArgumentError, ~r/unknown unit "metre"/, fn -> Unit.new!(5, :metre) end
    end
  end

  describe "convert" do
    for {from, to, value} <- [
          {~u(1 kilometer), :meter, 1000},
          {~u(1 meter), :kilometer, 0.001},
          {~u(1 inch), :millimeter, 25.4},
          {~u(1 mile), :meter, 1609.344},
          {~u(180 degree), :radian, :math.pi()},
          {~u(1 revolution), :degree, 360},
          {~u(60 arc_minute), :degree, 1},
          {~u(1 millidegree), :degree, 0.001},
          {~u(100 millisecond), :nanosecond, 100_000_000},
          {~u(2 hour), :minute, 120},
          {~u(1 kilohertz), :hertz, 1000},
          {~u(3000 revolution_per_minute), :revolution_per_second, 50},
          {~u(1 kilogram), :gram, 1000},
          {~u(1 pound), :kilogram, 0.45359237},
          {~u(1 kilogram_force), :newton, 9.80665},
          {~u(2 pound_force), :newton, 8.896443230521},
          {~u(1 newton_meter), :joule, 1},
          {~u(100 newton_centimeter), :newton_meter, 1},
          {~u(5 volt_ampere), :watt, 5},
          {~u(10 volt_per_ampere), :ohm, 10},
          {~u(2 ampere_hour), :coulomb, 7200},
          {~u(1 g_force), :meter_per_second_squared, 9.80665},
          {~u(1 meter_per_square_second), :meter_per_second_squared, 1},
          {~u(36 kilometer_per_hour), :meter_per_second, 10},
          {~u(1 cubic_meter), :liter, 1000},
          {~u(1 square_kilometer), :square_meter, 1_000_000},
          {~u(25 celsius), :kelvin, 298.15},
          {~u(32 fahrenheit), :celsius, 0},
          {~u(-40 celsius), :fahrenheit, -40},
          {~u(9 fahrenheit_per_second), :celsius_per_second, 5},
          {~u(1 celsius_per_second), :kelvin_per_second, 1},
          {~u(50 percent), :percent, 50}
        ] do
      test "#{inspect(from)} is #{value} #{to}" do
        assert {:ok, %Unit{value: value}} = Unit.convert(unquote(Macro.escape(from)), unquote(to))
        assert_in_delta value, unquote(value), 1.0e-12 * abs(unquote(value))
        assert is_integer(value) or is_float(unquote(value))
      end
    end

    test "refuses another kind, in words" do
      assert {:error, error} = Unit.convert(~u(1 radian_per_second), :hertz)

      assert Exception.message(error) ==
               "cannot convert 1 radian per second to hertz: 1 radian per second is an angular speed, hertz is a frequency"

      assert_raise ArgumentError, ~r/cannot convert/, fn ->
        Unit.convert!(~u(1 meter), :second)
      end
    end

    test "refuses an unknown unit" do
      assert {:error, %ArgumentError{message: "unknown unit \"metr\"" <> _}} =
               Unit.convert(~u(1 meter), :metr)
    end

    property "there and back is where it was" do
      names = [:meter, :inch, :nanometer, :mile, :foot, :kilometer]

      forall {value, from, to} <- {float(), oneof(names), oneof(names)} do
        back = Unit.new!(value, from) |> Unit.convert!(to) |> Unit.convert!(from)
        abs(back.value - value) <= 1.0e-12 * abs(value)
      end
    end

    property "whole numbers are exact" do
      forall {value, power} <- {integer(), oneof([:millimeter, :micrometer, :nanometer])} do
        unit = Unit.new!(value, :kilometer)
        unit |> Unit.convert!(power) |> Unit.convert!(:kilometer) === unit
      end
    end
  end

  describe "every kind of quantity" do
    # Each SI unit with other units of its dimensions.
    for {si, others} <- [
          meter: ~w(inch foot mile),
          radian: ~w(degree revolution arc_minute),
          second: ~w(minute hour day),
          hertz: ~w(per_second),
          gram: ~w(tonne pound ounce),
          newton: ~w(kilogram_force pound_force kilogram_meter_per_second_squared),
          newton_meter: ~w(joule newton_centimeter),
          volt: ~w(watt_per_ampere),
          ampere: ~w(watt_per_volt),
          ohm: ~w(volt_per_ampere),
          kelvin: ~w(celsius fahrenheit)
        ] do
      test "takes SI prefixes and makes rates: #{si}" do
        si = unquote(to_string(si))
        compatible = unquote(others)

        for {prefix, exponent} <- BB.Unit.Name.prefixes() do
          value = Unit.convert!(Unit.new!(1, prefix <> si), si).value
          assert_in_delta value / :math.pow(10, exponent), 1, 1.0e-12
        end

        for other <- compatible, do: assert(Unit.compatible?(other, si))

        rate = Unit.new!(60, "#{si}_per_minute")
        assert_in_delta Unit.convert!(rate, "#{si}_per_second").value, 1, 1.0e-12
        assert Unit.to_string!(rate) == "60 #{String.replace(si, "_", " ")} per minute"
        refute Unit.compatible?(rate, si)
      end
    end
  end

  describe "to_si" do
    test "is a float in the coherent unit" do
      assert Unit.to_si(~u(100 hertz)) === 100.0
      assert Unit.to_si(~u(1 gram)) === 0.001
      assert_in_delta Unit.to_si(~u(60 degree_per_second)), :math.pi() / 3, 1.0e-15
      assert Unit.to_si(~u(20 kiloohm)) === 20_000.0
      assert Unit.to_si(~u(212 fahrenheit)) == 373.15
    end
  end

  describe "compare" do
    test "is by quantity, whatever the unit" do
      assert Unit.compare(~u(1 inch), ~u(25.4 millimeter)) == :eq
      assert Unit.compare(~u(0 celsius), ~u(0 kelvin)) == :gt

      assert Enum.sort([~u(1 meter), ~u(1 inch), ~u(1 foot)], Unit) == [
               ~u(1 inch),
               ~u(1 foot),
               ~u(1 meter)
             ]
    end

    test "raises for different kinds" do
      assert_raise ArgumentError, ~r/cannot convert 1 second to meter/, fn ->
        Unit.compare(~u(1 meter), ~u(1 second))
      end
    end
  end

  describe "compatible?" do
    test "takes quantities and names" do
      assert Unit.compatible?(~u(1 newton_meter), :kilogram_square_meter_per_square_second)
      assert Unit.compatible?(~u(1 degree), ~u(1 radian))
      refute Unit.compatible?(~u(1 degree), ~u(1 meter))

      assert_raise ArgumentError, ~r/unknown unit "metr"/, fn ->
        Unit.compatible?(:meter, :metr)
      end
    end
  end

  test "a quantity is shown as one would write it" do
    assert inspect(~u(5 meter_per_second)) == "~u(5 meter_per_second)"
    assert "#{~u(0.5 newton_meter)}" == "0.5 newton meter"
  end
end
