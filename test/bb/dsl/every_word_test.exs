defmodule BB.Dsl.EveryWordTest do
  # Captures the output of all processes on stderr.
  use ExUnit.Case, async: false

  import BB.Unit, only: :sigils
  import ExUnit.CaptureIO

  alias BB.Dsl.{Grammar, Info}
  alias BB.Parameter.Reference

  @file_name "test/support/robots/every_word.exs"
  @pi :math.pi()

  setup_all do
    warnings = capture_io(:stderr, fn -> Code.compile_file(@file_name) end)
    %{robot: BB.Test.EveryWord, warnings: warnings}
  end

  test "the robot has every word of the grammar" do
    text = File.read!(@file_name)

    for {word, _arity} <- Grammar.calls() do
      name = Regex.escape("#{word}")
      assert text =~ ~r/\b#{name}(:|\(| |\n)/, "#{@file_name} has no #{word}"
    end
  end

  test "it compiles, with a warning for each module that does not exist", %{warnings: warnings} do
    for module <- ~w(Bridge Charge Pose),
        do: assert(warnings =~ "module BB.Test.Nowhere.#{module} cannot be loaded")
  end

  test "it starts", %{robot: robot} do
    start_supervised!(robot)
    assert BB.Test.Eventually.eventually(fn -> BB.Test.Robot.health(robot, :imu).state == :up end)
    resolved = BB.Robot.Runtime.get_robot(robot)
    assert elem(resolved.joints.shoulder.origin.position, 2) == 0.1
    assert_in_delta resolved.joints.shoulder.limits.upper, @pi / 2, 1.0e-12
    assert resolved.sensors.encoder.transmission.reduction == 2.0
    :ok = BB.Parameter.set(robot, [:arm, :reach, :height], ~u(2 meter))
    assert elem(BB.Robot.Runtime.get_robot(robot).joints.shoulder.origin.position, 2) == 2.0
  end

  describe "its links" do
    test "have mass, centre of mass and inertia in SI", %{robot: robot} do
      assert {:ok, base} = BB.Robot.get_link(robot.robot(), :base)
      assert base.mass == 2.5
      assert base.center_of_mass == {0.01, -0.02, 0.03}

      assert base.inertia ==
               %{ixx: 0.1, iyy: 0.2, izz: 0.3, ixy: 0.01, ixz: 0.02, iyz: 0.03}

      assert {:ok, %{mass: nil, center_of_mass: nil, inertia: nil, visual: nil, collisions: []}} =
               BB.Robot.get_link(robot.robot(), :finger)
    end

    test "have shapes in m, with material and origin", %{robot: robot} do
      %{base: base, upper: upper} = robot.robot().links
      assert base.visual.geometry == {:box, %{x: 0.4, y: 0.3, z: 0.1}}
      assert {{_x, _y, 0.05}, {_roll, _pitch, yaw}} = base.visual.origin
      assert_in_delta yaw, @pi, 1.0e-12

      assert base.visual.material == %{
               name: :grey,
               color: %{red: 0.5, green: 0.5, blue: 0.5, alpha: 0.9},
               texture: "steel.png"
             }

      assert [
               %{name: :hull, origin: nil, geometry: {:cylinder, %{radius: 0.2, height: 0.1}}},
               %{name: :dome, origin: {{_, _, 0.1}, _}, geometry: {:sphere, %{radius: 0.2}}},
               %{name: :collision_0, geometry: {:capsule, %{radius: 0.05, length: 0.2}}}
             ] = base.collisions

      assert upper.visual == %{
               origin: nil,
               geometry: {:mesh, %{filename: "upper.stl", scale: 2}},
               material: nil
             }
    end

    test "are in the order of the declaration", %{robot: robot} do
      links = for link <- BB.Robot.links_in_order(robot.robot()), do: link.name
      assert links == [:base, :upper, :finger, :link_0, :cart, :drone, :tip]
    end
  end

  describe "its joints" do
    test "have limits, dynamics and axis in SI", %{robot: robot} do
      %{shoulder: shoulder, slide: slide} = robot.robot().joints
      assert %{effort: 10.0, upper: nil} = shoulder.limits
      assert_in_delta shoulder.limits.lower, -@pi / 2, 1.0e-12
      assert_in_delta shoulder.limits.velocity, @pi / 3, 1.0e-12
      assert_in_delta shoulder.limits.acceleration, @pi, 1.0e-12
      assert_in_delta shoulder.dynamics.damping, 57.29577951308232, 1.0e-9
      assert shoulder.dynamics.friction == 0.5
      assert {1.0, 2.0, nil} = shoulder.origin.position
      assert_in_delta elem(shoulder.origin.orientation, 2), @pi / 6, 1.0e-12
      assert_axis(shoulder.axis, {0.0, 1.0, 0.0})

      assert slide.limits ==
               %{lower: 0.0, upper: 0.5, effort: 20.0, velocity: 0.1, acceleration: 1.0}

      assert slide.dynamics == %{damping: 3.0, friction: 1.0}
      assert_axis(slide.axis, {0.6, 0.0, 0.8})
      assert robot.robot().joints.joint_0.axis == nil
      assert_axis(robot.robot().joints.plane.axis, {0.0, 0.0, 1.0})
    end

    test "have types with degrees of freedom", %{robot: robot} do
      dofs = for joint <- BB.Robot.joints_in_order(robot.robot()), do: BB.Robot.Joint.dof(joint)
      assert dofs == [1, 1, 1, 3, 6, 0]
    end

    test "have sensors and actuators with transmissions in SI", %{robot: robot} do
      %{sensors: sensors, actuators: actuators} = robot.robot()
      assert %{reduction: nil, reversed?: true} = sensors.encoder.transmission
      assert_in_delta sensors.encoder.transmission.offset, @pi / 2, 1.0e-12
      assert sensors.battery.attached_to == :robot

      assert actuators.motor == %{
               name: :motor,
               joint: :shoulder,
               attached_to: {:joint, :shoulder},
               transmission: %{reduction: -3.0, offset: 0.0, reversed?: false}
             }
    end
  end

  test "its places that follow parameters are listed", %{robot: robot} do
    assert robot.robot().param_subscriptions == %{
             [:arm, :gear] => [{:sensor, :encoder, [:transmission, :reduction]}],
             [:arm, :reach, :height] => [{:joint, :shoulder, [:origin, :z]}],
             [:top] => [{:joint, :shoulder, [:limits, :upper]}]
           }
  end

  test "BB.Robot.Builder.build makes the same robot", %{robot: robot} do
    assert BB.Robot.Builder.build(robot) == robot.robot()
  end

  describe "BB.Dsl.Info" do
    test "returns the settings", %{robot: robot} do
      assert Info.settings(robot) == %{
               registry_module: Registry,
               registry_options: [partitions: 1],
               supervisor_module: Supervisor,
               parameter_store: nil,
               topology_max_restarts: 5,
               topology_max_seconds: 10
             }

      assert Info.settings_name(robot) == {:ok, :every_word}
      assert Info.settings_topology_max_restarts(robot) == {:ok, 5}
      assert Info.settings_parameter_store(robot) == :error
      assert_raise ArgumentError, fn -> Info.settings_parameter_store!(robot) end
    end

    test "returns the topology as written", %{robot: robot} do
      assert [%BB.Dsl.Link{name: :base, joints: [shoulder]} = base] = Info.topology(robot)
      assert %BB.Dsl.Inertial{mass: ~u(2500 gram), origin: %BB.Dsl.Origin{}} = base.inertial
      assert %BB.Dsl.Inertia{ixy: ~u(0.01 kilogram_square_meter)} = base.inertial.inertia
      assert %BB.Dsl.Visual{geometry: %BB.Dsl.Box{x: ~u(40 centimeter)}} = base.visual
      assert %BB.Dsl.Material{color: %BB.Dsl.Color{alpha: 0.9}} = base.visual.material
      assert %BB.Dsl.Texture{filename: "steel.png"} = base.visual.material.texture
      assert [%BB.Dsl.Collision{name: :hull}, _, %{name: :collision_0}] = base.collisions

      assert %BB.Dsl.Joint{name: :shoulder, type: :revolute} = shoulder
      assert shoulder.origin.z == %Reference{path: [:arm, :reach, :height]}
      assert %BB.Dsl.Axis{roll: ~u(-90 degree), yaw: ~u(0 degree)} = shoulder.axis
      assert %BB.Dsl.Limit{effort: ~u(10 newton_meter)} = shoulder.limit
      assert %BB.Dsl.Dynamics{friction: ~u(0.5 newton_meter)} = shoulder.dynamics
      assert [%BB.Dsl.Actuator{child_spec: {BB.Test.Motor, rate: 1}}] = shoulder.actuators
      assert [%BB.Dsl.Sensor{transmission: transmission}] = shoulder.sensors
      assert %BB.Dsl.Transmission{offset: ~u(90 degree), reversed?: true} = transmission
    end

    test "returns estimators with inputs and outputs", %{robot: robot} do
      assert [%BB.Dsl.Sensor{estimators: [charge]}] = Info.sensors(robot)

      assert %BB.Dsl.Estimator{name: :charge, inputs: [], recover_after: 3, on_lost: :stop} =
               charge

      assert [%{estimators: [pose]}] = Info.topology(robot)
      assert pose.sync_tolerance == ~u(20 millisecond)

      assert pose.inputs == [
               %BB.Dsl.Estimator.Input{
                 name: :imu,
                 path: [:sensor, :base, :imu],
                 driver?: true
               },
               %BB.Dsl.Estimator.Input{name: :gps, path: [:sensor, :base, :gps], driver?: false}
             ]

      assert pose.outputs == [
               %BB.Dsl.Estimator.Output{name: :out, path: nil},
               %BB.Dsl.Estimator.Output{name: :fast, path: [:fast_pose]}
             ]
    end

    test "returns parameters, groups, bridges and controllers", %{robot: robot} do
      assert [
               %BB.Dsl.Param{name: :debug, type: :boolean, default: false, doc: "Whether" <> _},
               %BB.Dsl.ParamGroup{name: :arm, doc: "The arm.", params: [gear], groups: [reach]},
               %BB.Dsl.Bridge{name: :remote, simulation: :mock},
               %BB.Dsl.Param{name: :top}
             ] = Info.parameters(robot)

      assert %BB.Dsl.Param{min: 0.5, max: 10.0} = gear
      assert %BB.Dsl.ParamGroup{doc: "How far it reaches.", params: [%{name: :height}]} = reach

      assert [%BB.Dsl.Controller{simulation: :start}, %{name: :other, simulation: :omit}] =
               Info.controllers(robot)
    end

    test "returns commands, categories and states", %{robot: robot} do
      assert [
               %BB.Dsl.Category{name: :motion, concurrency_limit: 2},
               %BB.Dsl.Command{name: :arm, arm: true, allowed_states: [:disarmed]},
               %BB.Dsl.Command{name: :stop, disarm: true, allowed_states: [:*], cancel: [:*]},
               %BB.Dsl.Command{name: :home, timeout: 5_000, category: :motion} = home
             ] = Info.commands(robot)

      assert [speed, mode] = home.arguments
      assert %BB.Dsl.Command.Argument{name: :speed, type: :float, default: 0.5} = speed
      assert %{type: {:in, [:slow, :fast]}, required: true} = mode
      assert Info.state_names(robot) == [:idle, :working]
      assert robot.__bb_initial_state__() == :working
      assert robot.__bb_category_limits__() == %{default: 1, motion: 2}
      assert robot.__bb_arm_command__() == :arm
      assert robot.__bb_disarm_command__() == :stop
    end
  end

  defp assert_axis({x, y, z}, {a, b, c}) do
    for {given, expected} <- [{x, a}, {y, b}, {z, c}],
        do: assert_in_delta(given, expected, 1.0e-12)
  end
end
