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
      assert ~u(+5 meter).value == 5
      assert ~u(1e3 meter).value === 1000.0
    end

    test "needs no blank between the number and the unit" do
      assert ~u(100centimeter) == %Unit{name: "centimeter", value: 100}
      assert ~u(-0.5exameter) == %Unit{name: "exameter", value: -0.5}
      assert ~u( 5  meter ) == ~u(5 meter)
    end

    test "keeps an integer an integer" do
      assert ~u(10 meter_per_second).value === 10
      assert ~u(10.0 meter_per_second).value === 10.0
    end

    test "stands in functions, attributes, defaults of structs and arguments" do
      {{:module, module, _binary, _last}, _bindings} =
        evaluate("""
        defmodule BB.UnitTest.Everywhere do
          import BB.Unit
          @rate ~u(2 hertz)
          defstruct length: ~u(1 meter)
          def rates(rate \\\\ ~u(3 hertz)), do: [@rate, rate | Enum.map([1], fn _ -> ~u(4hertz) end)]
        end
        """)

      assert struct(module).length == ~u(1 meter)
      assert module.rates() == [~u(2 hertz), ~u(3 hertz), ~u(4 hertz)]
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
            "~u(5.meter)",
            "~u(.5 meter)",
            "~u(--5 meter)",
            "~u(1_ meter)",
            "~u(1.0e999 meter)",
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

    test "creates the quantity 1 of a name" do
      assert Unit.new("meter") == {:ok, ~u(1 meter)}
      assert {:error, %ArgumentError{}} = Unit.new("metre")
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

  describe "unit_name" do
    test "has dashes, whether the unit exists or not" do
      for {name, dashed} <- [
            {:newton_meter, "newton-meter"},
            {"meter_per_second", "meter-per-second"},
            {"meter", "meter"},
            {:no_such_unit, "no-such-unit"}
          ],
          do: assert(Unit.unit_name(name) == dashed)

      assert_raise FunctionClauseError, fn -> Unit.unit_name(5) end
    end
  end

  describe "validate_unit" do
    test "takes atoms and strings, with _ or -" do
      for name <- [:newton_meter, "newton_meter", "newton-meter"],
          do: assert(Unit.validate_unit(name) == {:ok, "newton-meter"})
    end

    test "returns the exception of an unknown unit" do
      for name <- [:blurb, "meter_per", "", nil, true, 5],
          do: assert({:error, %ArgumentError{}} = Unit.validate_unit(name))
    end
  end

  # The units of drivers and robots that were written for Beam Bots.
  @written ~w(
    meter centimeter millimeter kilometer_per_hour meter_per_second meter_per_square_second
    degree radian degree_per_second radian_per_second degree_per_square_second
    radian_per_square_second hertz kilohertz second millisecond gram kilogram
    kilogram_square_meter newton newton_meter newton_second_per_meter
    newton_meter_second_per_radian newton_meter_second_per_degree volt ampere milliampere ohm
    celsius
  )

  for name <- @written do
    test "#{name} is parsed, converted, compared and shown" do
      name = unquote(name)
      assert {:ok, %Unit{value: 2} = unit} = Unit.parse("2 #{name}")
      assert Unit.validate_unit(name) == {:ok, unit.name}
      assert Unit.convert(unit, name) == {:ok, unit}
      assert Unit.compare(unit, Unit.new!(1, name)) == :gt
      assert Unit.compatible?(unit, String.to_atom(name))
      assert Unit.to_string!(unit) == "2 #{String.replace(name, "_", " ")}"
      assert Unit.to_string!(unit, style: :short) =~ ~r/^2 ?\S+$/
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

    test "of different kinds is an error; compare! raises it" do
      assert {:error, %ArgumentError{} = error} = Unit.compare(~u(1 meter), ~u(1 second))

      assert error.message ==
               "cannot compare 1 meter with 1 second: 1 meter is a length, 1 second is a time"

      assert_raise ArgumentError, error.message, fn ->
        Unit.compare!(~u(1 meter), ~u(1 second))
      end

      assert Unit.compare!(~u(1 meter), ~u(1 inch)) == :gt
    end

    test "is exact across prefixes" do
      for {a, b} <- [
            {~u(150 centimeter), ~u(1.5 meter)},
            {~u(14.8 centimeter), ~u(0.148 meter)},
            {~u(0.1 kilohertz), ~u(100 hertz)},
            {~u(9007199254740993 nanosecond), ~u(9007199.254740993 second)},
            {~u(180 degree), Unit.new!(:math.pi(), :radian)},
            {~u(20 celsius), ~u(293.15 kelvin)}
          ] do
        assert Unit.compare(a, b) == :eq
        assert Unit.compare(b, a) == :eq
      end

      assert Unit.compare(~u(9007199254740993 second), ~u(9007199254740992 second)) == :gt
    end

    property "is the opposite in the opposite order" do
      names = [:degree, :radian, :revolution, :millidegree]
      angle = {oneof([float(), integer()]), oneof(names)}

      forall {{a, from}, {b, to}} <- {angle, angle} do
        {a, b} = {Unit.new!(a, from), Unit.new!(b, to)}
        Unit.compare(b, a) == %{lt: :gt, gt: :lt, eq: :eq}[Unit.compare(a, b)]
      end
    end
  end

  describe "to_string!" do
    test "has words, symbols, or symbols without a space" do
      for {unit, long, short, narrow} <- [
            {~u(5 meter), "5 meter", "5 m", "5m"},
            {~u(0.5 newton_meter), "0.5 newton meter", "0.5 N·m", "0.5N·m"},
            {~u(3 meter_per_square_second), "3 meter per square second", "3 m/s²", "3m/s²"},
            {~u(2 kilogram_square_meter), "2 kilogram square meter", "2 kg·m²", "2kg·m²"},
            {~u(90 degree), "90 degree", "90°", "90°"},
            {~u(9 degree_per_second), "9 degree per second", "9 °/s", "9°/s"},
            {~u(20 celsius), "20 celsius", "20 °C", "20°C"},
            {~u(4 per_second), "4 per second", "4 1/s", "41/s"},
            {~u(1 joule_per_kilogram_kelvin), "1 joule per kilogram kelvin", "1 J/(kg·K)",
             "1J/(kg·K)"},
            {~u(7 millivolt), "7 millivolt", "7 mV", "7mV"}
          ] do
        assert Unit.to_string!(unit) == long
        assert Unit.to_string!(unit, style: :long) == long
        assert Unit.to_string!(unit, style: :short) == short
        assert Unit.to_string!(unit, style: :narrow) == narrow
      end
    end

    test "takes a list" do
      assert Unit.to_string!([]) == ""
      assert Unit.to_string!([~u(5 foot), ~u(3 inch)]) == "5 foot, 3 inch"
      assert Unit.to_string!([~u(5 foot), ~u(3 inch)], style: :short) == "5 ft, 3 in"
    end

    test "refuses another style" do
      assert_raise ArgumentError, "expected :long, :short or :narrow as style, got: :tiny", fn ->
        Unit.to_string!(~u(5 foot), style: :tiny)
      end
    end

    test "has a symbol for every unit and prefix" do
      for name <- Unit.Name.known(),
          do: assert(Unit.to_string!(Unit.new!(1, name), style: :narrow) =~ ~r/^1\S+$/)

      symbols =
        for {prefix, _} <- Unit.Name.prefixes(),
            do: Unit.to_string!(Unit.new!(1, prefix <> "watt"), style: :short)

      assert length(Enum.uniq(symbols)) == length(symbols) - 1
      assert "1 µW" in symbols
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
