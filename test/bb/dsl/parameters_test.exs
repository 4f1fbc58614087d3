defmodule BB.Dsl.ParametersTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Mistake
  import BB.Test.Robot
  import ExUnit.CaptureIO
  import BB.Unit, only: :sigils

  alias BB.Parameter.Definition

  def even(value) when is_integer(value) and rem(value, 2) == 0, do: {:ok, value}
  def even(:raise), do: raise("oops")
  def even(value), do: {:error, "expected an even number, got: #{inspect(value)}"}

  describe "parameters" do
    test "are part of the robot, in the order of their declaration" do
      robot =
        robot do
          parameters do
            param :debug, type: :boolean, default: false, doc: "Say more."

            group :imu do
              param :rate do
                type {:unit, :hertz}
                default ~u(0.1 kilohertz)
                min ~u(1 hertz)
              end

              group :filter do
                param(:gain, type: :float, max: 1)
              end
            end

            param :modes, type: {:list, {:in, [:slow, :fast]}}, default: [:slow]
          end
        end

      assert [debug, rate, gain, modes] = robot.robot().parameters

      assert debug == %Definition{
               path: [:debug],
               type: :boolean,
               default: false,
               doc: "Say more."
             }

      assert %{path: [:imu, :rate], min: ~u(1 hertz), default: %BB.Unit{name: "hertz"}} = rate
      assert %{path: [:imu, :filter, :gain], default: nil, max: 1} = gain
      assert %{path: [:modes], default: [:slow]} = modes
    end

    for {what, fields, reason} <- [
          {"bounds on a boolean", "type: :boolean, min: 1",
           "`min` and `max` are only supported for numeric parameter types, got: :boolean; remove them"},
          {"bounds on a choice", "type: {:in, 1..3}, max: 2",
           "`min` and `max` are only supported for numeric parameter types, got: {:in, 1..3}; remove them"},
          {"min > max", "type: :integer, min: 2, max: 1",
           "`min` must not be greater than `max`, got: 2 and 1; swap them"},
          {"min > max in units", "type: {:unit, :meter}, min: ~u(2 meter), max: ~u(1 meter)",
           "`min` must not be greater than `max`, got: ~u(2 meter) and ~u(1 meter); swap them"},
          {"a default outside its bounds", "type: :float, default: 2.0, max: 1.0",
           "invalid `default`: expected value to be at most 1.0, got: 2.0"},
          {"a default of another type", "type: :float, default: 2",
           "invalid `default`: expected float, got: 2"},
          {"a numeric bound on a unit", "type: {:unit, :hertz}, min: 1",
           "`min` must be a `BB.Unit` compatible with `hertz`, got: 1"},
          {"an incompatible unit", "type: {:unit, :hertz}, max: ~u(1 meter)",
           "`max` must be compatible with `hertz`, got: ~u(1 meter)"},
          {"a default in an incompatible unit", "type: {:unit, :hertz}, default: ~u(1 meter)",
           "invalid `default`: cannot convert 1 meter to hertz: 1 meter is a length, hertz is a frequency"},
          {"a unit as the bound of a number", "type: :float, max: ~u(1 meter)",
           "`max` must be a number, got: ~u(1 meter)"},
          {"no type", "default: 1", "the type is missing; add `type:`, such as `type: :float`"},
          {"an unknown type", "type: :flaot",
           "expected a type, got: :flaot; use #{BB.Options.Type.known()}, or {:unit, unit}"},
          {"an unknown unit", "type: {:unit, :metre}",
           ~s(unknown unit "metre"; did you mean meter or ampere?)}
        ] do
      test "declared wrong, with #{what}, are a BB.Dsl.Error with the full path" do
        error =
          mistake("""
            parameters do
              group :arm do
                param :gain, #{unquote(fields)}
              end
            end
          """)

        assert error.path == [:parameters, :arm, :gain]
        assert error.line == 5
        assert error.reason == "parameter [:arm, :gain]: #{unquote(reason)}"
      end
    end

    test "of one path are a mistake, of one name in different groups are not" do
      error =
        mistake("""
          parameters do
            group :arm do
              param :gain, type: :float
              param :gain, type: :float
            end
          end
        """)

      assert error.path == [:parameters, :arm, :gain]
      assert error.reason =~ "duplicate name :gain: param :gain has the name of a param"

      error = mistake("parameters do\n param :arm, type: :float\n group :arm do\n end\n end")

      assert error.reason =~ "duplicate name :arm: group :arm has the name of a param"

      robot =
        robot do
          parameters do
            param :gain, type: :float

            group :arm do
              param :gain, type: :float
            end
          end
        end

      assert for(%{path: path} <- robot.robot().parameters, do: path) == [[:gain], [:arm, :gain]]
    end

    test "may have any type of BB.Options, and a custom type fails like another" do
      robot =
        robot do
          parameters do
            param :int1_pin, type: {:or, [:non_neg_integer, nil]}
            param :mode, type: {:in, [:slow, :fast]}, default: :slow
            param :ports, type: {:list, :pos_integer}, default: [1, 2]
            param :timeout, type: :timeout, default: :infinity
            param :even, type: {:custom, BB.Dsl.ParametersTest, :even, []}, default: 2
            param :reach, type: {:or, [{:unit, :meter}, nil]}, default: ~u(1 kilometer)
          end
        end

      assert for(
               %{path: [name], default: default} <- robot.robot().parameters,
               do: {name, default}
             ) ==
               [
                 int1_pin: nil,
                 mode: :slow,
                 ports: [1, 2],
                 timeout: :infinity,
                 even: 2,
                 reach: ~u(1000 meter)
               ]

      for {default, reason} <- [
            {"1", "expected an even number, got: 1"},
            {":raise", "the check of its type raised RuntimeError: oops"}
          ] do
        error =
          mistake("""
          parameters do
            param :even, type: {:custom, BB.Dsl.ParametersTest, :even, []}, default: #{default}
          end
          """)

        assert error.path == [:parameters, :even]
        assert error.reason == "parameter [:even]: invalid `default`: #{reason}"
      end
    end

    test "have no other fields" do
      error = mistake("parameters do\n param :gain, type: :float, defualt: 1.0\n end")

      assert error.reason ==
               "a parameter has no :defualt; it takes :doc, :type, :default, :min, :max"
    end
  end

  describe "a reference to a parameter" do
    test "stands for options and for fields of transmission, limit, origin and axis, and the robot lists them" do
      robot =
        robot do
          # What follows may stand before what it follows.
          controllers do
            controller :balance, {BB.Test.Brain, rate: param([:rate])}
          end

          sensors do
            sensor :probe, {BB.Test.Probe, rate: param([:rate])}
          end

          topology do
            link :base do
              joint :elbow do
                type :revolute

                limit lower: ~u(0 degree),
                      upper: param([:arm, :top]),
                      effort: ~u(1 newton_meter),
                      velocity: ~u(1 radian_per_second)

                origin do
                  z param([:arm, :height])
                end

                axis z: param([:arm, :axis])

                actuator :servo, {BB.Test.Motor, rate: param([:rate])} do
                  transmission reduction: param([:arm, :gear])
                end

                link :arm
              end
            end
          end

          parameters do
            param :rate, type: :integer, default: 5

            group :arm do
              param :top, type: {:unit, :degree}, default: ~u(90 degree)
              param :height, type: {:unit, :meter}, default: ~u(1 meter)
              param :axis, type: :float, default: 1.0
              param :gear, type: :float, default: 2.0
            end
          end
        end

      declared = robot.robot()

      assert declared.param_subscriptions == %{
               [:arm, :gear] => [{:actuator, :servo, [:transmission, :reduction]}],
               [:arm, :top] => [{:joint, :elbow, [:limits, :upper]}],
               [:arm, :height] => [{:joint, :elbow, [:origin, :z]}],
               [:arm, :axis] => [{:joint, :elbow, [:axis, :z]}]
             }

      assert declared.joints.elbow.origin.position == {0.0, 0.0, nil}
      assert declared.joints.elbow.axis == nil

      assert declared.actuators == %{
               servo: %{
                 name: :servo,
                 joint: :elbow,
                 attached_to: {:joint, :elbow},
                 transmission: %{reduction: nil, offset: 0.0, reversed?: false}
               }
             }

      start_supervised!(robot)
      assert BB.call(robot, :servo, :options)[:rate] == 5
      assert BB.call(robot, :balance, :options)[:rate] == 5
      :ok = BB.Parameter.set_many(robot, [{[:rate], 6}, {[:arm, :gear], 3.0}])
      servo = BB.call(robot, :servo, :options)
      assert servo[:rate] == 6
      assert servo[:actuator_profile].transmission.reduction == 3.0
      assert BB.call(robot, :balance, :options)[:rate] == 6
    end

    test "to nothing is a mistake, with place and remedy" do
      error =
        mistake("""
          parameters do
            group :imu do
              param :rate, type: :integer, default: 1
            end
          end

          topology do
            link :base do
              sensor :imu, {BB.Test.Probe, rate: param([:imu, :rtae])}
            end
          end
        """)

      assert error.path == [:topology, :base, :imu]
      assert error.line == 11

      assert error.reason ==
               ":rate is param([:imu, :rtae]), and the robot has no such parameter; declare it in `parameters`, or correct the path: a close one is [:imu, :rate]"

      error = mistake("sensors do\n sensor :s, {BB.Test.Probe, rate: param([:rate])}\n end")

      assert error.reason ==
               ":rate is param([:rate]), and the robot has no parameters; declare it in `parameters`"
    end

    test "to nothing in a transmission, a limit, an origin or an axis is a mistake too" do
      joint = fn inside ->
        mistake(
          "topology do\n link :b do\n joint :j do\n type :revolute\n #{inside}\n link :a\n end\n end\n end"
        )
      end

      assert joint.(
               "limit upper: param([:top]), effort: ~u(1 newton_meter), velocity: ~u(1 radian_per_second)"
             ).reason =~ "limit: :upper is param([:top]), and"

      limit =
        "limit lower: ~u(0 degree), upper: ~u(1 degree), effort: ~u(1 newton_meter), velocity: ~u(1 radian_per_second)\n"

      assert joint.(limit <> "origin x: param([:far])").reason =~ ":x is param([:far]), and"
      assert joint.(limit <> "axis x: param([:far])").reason =~ ":x is param([:far]), and"

      assert joint.(
               limit <> "actuator :m, BB.Test.Motor do\n transmission offset: param([:o])\n end"
             ).reason =~
               "actuator :m: transmission: :offset is param([:o]), and"
    end

    test "to a parameter that does not fit is a mistake" do
      robot = fn type, inside ->
        mistake("""
        parameters do
          param :p, #{type}
        end

        topology do
          link :b do
            joint :j do
              type :revolute
              #{inside}
              link :a
            end
          end
        end
        """)
      end

      assert robot.(
               "type: {:unit, :meter}, default: ~u(1 meter)",
               "limit upper: param([:p]), effort: ~u(1 newton_meter), velocity: ~u(1 radian_per_second)"
             ).reason ==
               "limit: param([:p]) does not fit: Expected unit 1 meter of :upper to be compatible with degree: `meter` is not compatible with a `revolute` joint"

      limit =
        "limit upper: ~u(1 degree), effort: ~u(1 newton_meter), velocity: ~u(1 radian_per_second)\n"

      assert robot.(
               "type: :float, default: 0.0",
               limit <>
                 "actuator :m, BB.Test.Motor do\n transmission reduction: param([:p])\n end"
             ).reason =~
               "actuator :m: transmission: param([:p]) does not fit: invalid value for :reduction option: expected a number other than zero"
    end

    test "inside an option, or where nothing follows, is a mistake" do
      parameters = "parameters do\n param :p, type: :integer\n end\n"

      assert mistake(
               parameters <> "sensors do\n sensor :s, {BB.Test.Probe, rate: [param([:p])]}\n end"
             ).reason ==
               "option :rate has param([:p]) inside it; a parameter stands for a whole option"

      assert mistake(
               parameters <> "sensors do\n sensor :s, BB.Test.Probe, required: param([:p])\n end"
             ).reason ==
               "a sensor follows no parameter; write the value itself"
    end
  end

  describe "a transmission" do
    test "has plain numbers in SI units" do
      robot =
        robot do
          topology do
            link :base do
              joint :elbow do
                type :continuous

                sensor :encoder, BB.Test.Probe do
                  transmission do
                    reduction 2
                    offset ~u(180 degree)
                    reversed? true
                  end
                end

                sensor :other, BB.Test.Probe, transmission: [reduction: 3.0]
                link :arm
              end
            end
          end
        end

      sensors = robot.robot().sensors

      assert sensors.encoder.transmission == %{
               reduction: 2.0,
               offset: :math.pi(),
               reversed?: true
             }

      assert sensors.other.transmission == %{reduction: 3.0, offset: 0.0, reversed?: false}
    end

    test "outside a joint changes nothing, of which a warning tells" do
      warning =
        capture_io(:stderr, fn ->
          declared =
            robot do
              topology do
                link :base do
                  sensor :s, BB.Test.Probe do
                    transmission reduction: 2.0
                  end
                end
              end
            end

          assert declared.robot().sensors.s.transmission == nil
        end)

      assert warning =~ "sensor :s has a transmission and stands in a link, where nothing uses it"
    end

    test "with a reduction that is none, or an offset of the wrong kind, is a mistake" do
      joint = fn type, fields ->
        mistake(
          "topology do\n link :b do\n joint :j do\n type #{type}\n #{limit(type)}\n sensor :s, BB.Test.Probe do\n transmission #{fields}\n end\n link :a\n end\n end\n end"
        ).reason
      end

      assert joint.(":revolute", "reduction: 0") =~
               "expected a number other than zero, motor turns per joint turn, got: 0"

      assert joint.(":revolute", "offset: ~u(1 meter)") ==
               "sensor :s: transmission: Expected unit 1 meter of :offset to be compatible with degree: `meter` is not compatible with a `revolute` joint"

      assert joint.(":prismatic", "offset: ~u(1 degree)") =~
               "`degree` is not compatible with a `prismatic` joint"
    end

    defp limit(":prismatic"),
      do: "limit effort: ~u(1 newton), velocity: ~u(1 meter_per_second)"

    defp limit(":revolute"),
      do: "limit effort: ~u(1 newton_meter), velocity: ~u(1 radian_per_second)"
  end

  describe "settings" do
    test "of a store that is none are a mistake" do
      assert mistake("settings do\n parameter_store {String, []}\n end").reason ==
               "parameter_store: String must implement the BB.Parameter.Store behaviour; add `@behaviour BB.Parameter.Store` to it"
    end

    test "registry_module, registry_options and supervisor_module are what the robot runs on" do
      robot =
        robot do
          settings do
            registry_module BB.Dsl.ParametersTest.OwnRegistry
            registry_options partitions: 2
            supervisor_module BB.Dsl.ParametersTest.OwnSupervisor
          end

          topology do
            link :base do
              sensor :imu, BB.Test.Probe
            end
          end
        end

      start_supervised!(robot)
      assert {:via, BB.Dsl.ParametersTest.OwnRegistry, _} = BB.Process.via(robot, :imu)
      assert is_pid(BB.Process.whereis(robot, :imu))
      assert BB.call(robot, :imu, :hello) == {:error, :not_implemented}
      assert eventually(fn -> health(robot, :imu).state == :up end)
      assert [_, _] = Supervisor.which_children(BB.Process.registry_name(robot))
      started = :ets.match(:bb_test_own_supervisors, {robot, :"$1"})
      assert Enum.sort(started) == [[BB.Supervisor], [BB.Supervisor.Topology]]
    end
  end

  defmodule OwnRegistry do
    @moduledoc false
    defdelegate child_spec(opts), to: Registry
    defdelegate register_name(name, pid), to: Registry
    defdelegate unregister_name(name), to: Registry
    defdelegate whereis_name(name), to: Registry
    defdelegate send(name, message), to: Registry
    defdelegate register(registry, key, value), to: Registry
    defdelegate lookup(registry, key), to: Registry
    defdelegate update_value(registry, key, change), to: Registry
    defdelegate put_meta(registry, key, value), to: Registry
    defdelegate meta(registry, key), to: Registry
  end

  defmodule OwnSupervisor do
    @moduledoc false
    def start_link(module, {robot, _} = argument, opts) do
      :ets.insert(:bb_test_own_supervisors, {robot, module})
      Supervisor.start_link(module, argument, opts)
    end
  end

  setup_all do
    :ets.new(:bb_test_own_supervisors, [:named_table, :public, :bag])
    :ok
  end
end
