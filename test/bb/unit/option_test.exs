defmodule BB.Unit.OptionTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Parameter.Reference, only: [param: 1]
  import BB.Unit
  import BB.Unit.Option

  alias BB.Dsl.{Block, Grammar}
  alias BB.Options.ValidationError
  alias BB.Parameter.Reference
  alias BB.Unit

  doctest BB.Unit.Option

  describe "unit_type" do
    test "has the very options that were given, in their order" do
      assert unit_type() == {:custom, BB.Unit.Option, :validate, [[]]}

      for options <- [
            [compatible: :meter],
            [max: ~u(2 meter), compatible: "meter", min: ~u(1 centimeter)],
            [compatible: :degree, eq: ~u(1 radian)],
            [min: param([:slowest]), compatible: :hertz]
          ],
          do: assert(unit_type(options) == {:custom, BB.Unit.Option, :validate, [options]})
    end

    test "refuses unknown options and wrong values" do
      for options <- [
            [unit: :meter],
            [compatible: 5],
            [min: 1],
            [max: "2 meter"],
            [eq: :meter],
            [compatible: :meter, min: 0.5]
          ],
          do: assert_raise(ValidationError, fn -> unit_type(options) end)
    end

    test "refuses an unknown unit as the unit itself does" do
      {:error, error} = Unit.new(1, :metre)
      assert_raise ArgumentError, error.message, fn -> unit_type(compatible: :metre) end
    end

    test "refuses a bound of another kind, and names it" do
      for {options, key} <- [
            {[compatible: :meter, min: ~u(1 second)], "min"},
            {[compatible: :meter, min: ~u(1 meter), max: ~u(1 degree)], "max"},
            {[compatible: :meter, eq: ~u(1 degree)], "eq"},
            {[min: ~u(1 meter), max: ~u(1 degree)], "max"},
            {[max: ~u(1 degree), min: ~u(1 meter)], "max"},
            {[max: ~u(1 degree), eq: ~u(1 meter)], "eq"},
            {[min: param([:a]), max: ~u(1 degree), eq: ~u(1 meter)], "eq"}
          ] do
        error = assert_raise ValidationError, fn -> unit_type(options) end
        assert error.message =~ "invalid value for :#{key} option: expected a unit that is "
      end
    end
  end

  describe "a value" do
    test "is a quantity of the kind, as it was given" do
      for unit <- [~u(100 centimeter), ~u(1.5 meter), ~u(-3 inch)],
          do: assert(BB.Unit.Option.validate(unit, compatible: :meter) == {:ok, unit})

      assert BB.Unit.Option.validate(~u(1 second)) == {:ok, ~u(1 second)}
    end

    test "that is no quantity is refused" do
      for value <- [5, 5.0, nil, :meter, "not a unit", %{name: "meter", value: 1}, [~u(1 meter)]],
          do:
            assert(
              BB.Unit.Option.validate(value, compatible: :meter) ==
                {:error, "Value `#{inspect(value)}` is not a `BB.Unit` struct"}
            )

      assert {:error, "Value `" <> _} = BB.Unit.Option.validate(%Unit{name: "meter", value: nil})
      assert {:error, "unknown unit" <> _} = BB.Unit.Option.validate(%Unit{name: "x", value: 1})
    end

    test "of another kind is refused with both units" do
      assert BB.Unit.Option.validate(~u(5 degree_per_second), compatible: :meter_per_second) ==
               {:error, "The unit `degree-per-second` is not compatible with `meter_per_second`"}

      assert BB.Unit.Option.validate(~u(5 degree), min: ~u(1 meter)) ==
               {:error, "The unit `degree` is not compatible with `meter`"}
    end

    test "has inclusive bounds, across units" do
      options = [compatible: :meter, min: ~u(10 centimeter), max: ~u(1.5 meter)]

      for unit <- [~u(0.1 meter), ~u(150 centimeter), ~u(1 meter)],
          do: assert(BB.Unit.Option.validate(unit, options) == {:ok, unit})

      assert BB.Unit.Option.validate(~u(99 millimeter), options) ==
               {:error, "expected at least 10 centimeter, got: 99 millimeter"}

      assert BB.Unit.Option.validate(~u(151 centimeter), options) ==
               {:error, "expected at most 1.5 meter, got: 151 centimeter"}
    end

    test "equals eq by its quantity" do
      assert {:ok, ~u(100 centimeter)} =
               BB.Unit.Option.validate(~u(100 centimeter), eq: ~u(1 meter))

      assert BB.Unit.Option.validate(~u(2 meter), eq: ~u(1 meter)) ==
               {:error, "expected 1 meter, got: 2 meter"}
    end

    test "may be a reference, which learns the unit and is not checked otherwise" do
      for {options, expected} <- [
            {[], nil},
            {[compatible: :hertz], :hertz},
            {[compatible: "meter_per_second", min: ~u(1 meter_per_second)], "meter_per_second"}
          ] do
        assert BB.Unit.Option.validate(param([:a, :b]), options) ==
                 {:ok, %Reference{path: [:a, :b], expected_unit_type: expected}}
      end
    end

    test "is not checked against a bound that is a reference" do
      assert {:ok, _} = BB.Unit.Option.validate(~u(1 meter), min: param([:least]))
    end
  end

  property "is accepted exactly between its bounds" do
    names = [:meter, :centimeter, :inch, :kilometer]
    length = {oneof([integer(), float()]), oneof(names)}

    forall {{a, unit}, {b, low}, {c, high}} <- {length, length, length} do
      [value, min, max] = for {v, name} <- [{a, unit}, {b, low}, {c, high}], do: new!(v, name)
      within? = compare(value, min) != :lt and compare(value, max) != :gt
      verdict = BB.Unit.Option.validate(value, compatible: :meter, min: min, max: max)
      if within?, do: verdict == {:ok, value}, else: match?({:error, _}, verdict)
    end
  end

  describe "in a schema" do
    test "an option keeps its unit, a default too, and errors name the option" do
      schema =
        BB.Options.new!(
          rate: [type: unit_type(compatible: :hertz), default: ~u(2 hertz)],
          reach: [type: {:or, [unit_type(compatible: :meter), nil]}, default: nil]
        )

      assert {:ok, options} = BB.Options.validate([reach: ~u(5 centimeter)], schema)
      assert Enum.sort(options) == [rate: ~u(2 hertz), reach: ~u(5 centimeter)]
      assert {:error, error} = BB.Options.validate([rate: 2], schema)

      assert Exception.message(error) ==
               "invalid value for :rate option: Value `2` is not a `BB.Unit` struct"
    end
  end

  describe "the imports of a driver and of a robot" do
    test "do not clash" do
      [{robot, _} | _] =
        Code.compile_string("""
        defmodule BB.Unit.OptionTest.ImportingRobot do
          use BB
          import BB.Unit
          import BB.Unit.Option
          import BB.Message.Option
          import BB.Parameter.Reference

          @rate unit_type(compatible: :hertz, max: ~u(1 kilohertz))
          def rate, do: {@rate, unit_name(:hertz), convert!(~u(1 kilohertz), :hertz), vec3_type()}

          parameters do
            param :rate, type: {:unit, :hertz}, default: ~u(5hertz), min: ~u(1 hertz)
          end

          topology do
            link :base do
              sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1", rate: param([:rate])},
                max_silence: ~u(1 second)

              joint :shoulder, type: :revolute do
                origin z: ~u(0.1 meter)
                limit lower: ~u(-90 degree), upper: ~u(90 degree), effort: ~u(1 newton_meter), velocity: ~u(60 degree_per_second)
                link :arm
              end
            end
          end
        end
        """)

      assert {{:custom, BB.Unit.Option, :validate, _}, "hertz", ~u(1000 hertz),
              {:custom, _, _, _}} = robot.rate()
    end

    test "have no name twice" do
      imports = [Kernel, BB.Unit, BB.Unit.Option, BB.Message.Option, BB.Dsl.ParamRef]

      # Where parameters are declared, `param` is the word, and param/1 is not imported.
      for kind <- Grammar.kinds() -- [:parameters, :group],
          do: assert({kind, twice([Block.words(kind) | imports])} == {kind, []})
    end

    defp twice(modules) do
      names =
        for module <- modules,
            name <- module.__info__(:functions) ++ module.__info__(:macros),
            do: {name, module}

      for {name, [_, _ | _] = where} <- Enum.group_by(names, &elem(&1, 0)), do: {name, where}
    end
  end
end
