defmodule BB.Dsl.RobotsOfBeamBotsTest do
  # Robots and drivers as users of Beam Bots write them, in every style of writing.
  # Captures the output of all processes on stderr.
  use ExUnit.Case, async: false

  import BB.Test.Eventually
  import BB.Unit, only: :sigils
  import ExUnit.CaptureIO
  import ExUnit.CaptureLog

  alias BB.{Actuator, Message, Parameter, Robot, Safety}
  alias BB.Dsl.Info
  alias BB.Error.{Kinematics, State}
  alias BB.Math.{Transform, Transform2D}
  alias BB.Message.Actuator.{BeginMotion, Command}
  alias BB.Message.Sensor.{JointState, PowerState}
  alias BB.Robot.Runtime

  # Modules of test/support/robots_of_beam_bots, which the tests compile.
  @robots %{
    rover: BB.Test.BeamBots.Rover,
    arm: BB.Test.BeamBots.Arm,
    pan_tilt: BB.Test.BeamBots.PanTilt,
    leg: BB.Test.BeamBots.Leg,
    tuned: BB.Test.BeamBots.Tuned,
    barge: BB.Test.BeamBots.Barge,
    nothing: BB.Test.BeamBots.Nothing,
    one_link: BB.Test.BeamBots.OneLink,
    station: BB.Test.BeamBots.Station
  }
  @directory "test/support/robots_of_beam_bots"
  @pi :math.pi()

  setup_all do
    warnings =
      capture_io(:stderr, fn ->
        for file <- ~w(drivers rover arm pan_tilt leg tuned bare barge),
            do: Code.compile_file(Path.join(@directory, file <> ".exs"))
      end)

    Map.put(@robots, :warnings, warnings)
  end

  defp up(robot, names) do
    for name <- names do
      eventually(fn -> BB.Process.whereis(robot, name) != :undefined end)
      eventually(fn -> state(robot, name) == :up end)
    end
  end

  defp state(robot, name) do
    Enum.find_value([BB.Sensor, BB.Actuator, BB.Controller], fn kind ->
      Enum.find_value(kind.health(robot), &(&1.name == name && &1.state))
    end)
  end

  defp start(robot, names, opts \\ []) do
    start_supervised!({robot, opts})
    on_exit(fn -> Safety.force_disarm(robot) end)
    up(robot, names)
  end

  defp state_of(robot, name), do: :sys.get_state(BB.Process.whereis(robot, name)).user_state

  test "they compile without a warning, but for a bridge that no module implements", context do
    assert [_line] = Regex.scan(~r/^.*warning: .*$/m, context.warnings)
    assert context.warnings =~ "bridge :shore"
  end

  describe "a rover with differential drive" do
    test "has its description in SI", %{rover: rover} do
      robot = rover.robot()
      assert robot.name == rover
      assert Robot.root_link(robot) == :chassis
      assert {:ok, chassis} = Robot.get_link(robot, :chassis)
      assert chassis.mass == 1.2
      assert chassis.inertia == nil and chassis.center_of_mass == nil
      assert chassis.child_joints == [:left, :right, :caster]
      assert chassis.sensors == [:imu]
      assert chassis.visual.geometry == {:box, %{x: 0.2, y: 0.15, z: 0.05}}
      assert chassis.visual.origin == nil
      assert %{name: :red, color: color, texture: nil} = chassis.visual.material
      assert color == %{red: 1, green: 0, blue: 0, alpha: 1}

      assert {:ok, left} = Robot.get_joint(robot, :left)
      assert %{type: :continuous, parent_link: :chassis, child_link: :left_wheel} = left
      assert left.origin == %{position: {0.0, 0.08, 0.0}, orientation: {0.0, 0.0, 0.0}}
      assert {x, y, z} = left.axis
      assert_in_delta x, 0.0, 1.0e-12
      assert_in_delta y, 1.0, 1.0e-12
      assert_in_delta z, 0.0, 1.0e-12
      assert %{lower: nil, upper: nil, acceleration: nil, effort: 1.0} = left.limits
      assert_in_delta left.limits.velocity, 2 * @pi, 1.0e-12
      assert left.dynamics == nil and left.actuators == [:left_motor]
      assert {:ok, %{axis: nil, limits: nil, origin: nil}} = Robot.get_joint(robot, :caster)

      assert [%{name: name, origin: nil, geometry: {:cylinder, size}}] =
               robot.links.left_wheel.collisions

      assert is_atom(name) and size == %{radius: 0.035, height: 0.02}
      assert robot.sensors.imu.attached_to == {:link, :chassis}
      assert robot.actuators.right_motor.joint == :right
      assert robot.param_subscriptions == %{}

      assert robot.actuators.right_motor.transmission ==
               %{reduction: 2.0, offset: 0.0, reversed?: true}
    end

    test "has an order of links and joints", %{rover: rover} do
      robot = rover.robot()

      assert Enum.map(Robot.links_in_order(robot), & &1.name) ==
               [:chassis, :left_wheel, :right_wheel, :caster_wheel]

      assert Enum.map(Robot.joints_in_order(robot), & &1.name) == [:left, :right, :caster]
      assert {:ok, [:chassis, :left, :left_motor]} = Robot.actuator_path(robot, :left_motor)
      assert {:ok, [:chassis, :right, :right_wheel]} = Robot.path_to(robot, :right_wheel)
      assert {:ok, joints} = Robot.child_joints(robot, :chassis)
      assert Enum.map(joints, &Robot.Joint.dof/1) == [1, 1, 0]
      assert {:error, %Kinematics.UnknownLink{link: :no}} = Robot.get_link(robot, :no)
      assert {:error, %Kinematics.NoParentJoint{}} = Robot.parent_joint(robot, :chassis)

      assert {:error, %Kinematics.NotAnAncestor{common_ancestor: :chassis}} =
               Robot.path_between(robot, :left_wheel, :right_wheel)

      assert Robot.Topology.max_depth(robot.topology) == 1
    end

    test "has its declaration as written", %{rover: rover} do
      assert Info.settings_name(rover) == {:ok, :rover}
      assert Info.settings(rover).registry_options == []
      assert [%BB.Dsl.Sensor{name: :battery}, %{name: :supply}] = Info.sensors(rover)

      assert [%BB.Dsl.Controller{name: :mixer, simulation: :mock} = mixer] =
               Info.controllers(rover)

      assert mixer.child_spec == {BB.Test.BeamBots.Mixer, bus: "/dev/ttyAMA0"}
      assert hd(tl(Info.sensors(rover))).child_spec == BB.Test.BeamBots.Ticker

      assert [%BB.Dsl.Link{name: :chassis, joints: [left, right, caster]} = chassis] =
               Info.topology(rover)

      assert %BB.Dsl.Inertial{mass: ~u(1200 gram), origin: nil, inertia: nil} = chassis.inertial
      assert %BB.Dsl.Visual{geometry: %BB.Dsl.Box{x: ~u(20 centimeter)}} = chassis.visual
      assert %BB.Dsl.Joint{type: :continuous, axis: %BB.Dsl.Axis{roll: ~u(-90 degree)}} = left
      assert left.axis.yaw == ~u(0 degree)

      assert [%{transmission: %BB.Dsl.Transmission{reversed?: true, offset: nil}}] =
               right.actuators

      assert %{type: :fixed, limit: nil, link: %{name: :caster_wheel}} = caster
      assert rover.wheel_radius() == ~u(0.035 meter)
      assert rover.__bb_parameter_schema__() == []
    end

    test "drives", %{rover: rover} do
      start(rover, [:battery, :supply, :mixer, :imu, :left_motor, :right_motor])
      assert BB.Process.call(rover, :mixer, :bus) == {:ok, "/dev/ttyAMA0"}
      assert Runtime.state(rover) == :disarmed
      assert Runtime.simulation_mode(rover) == nil

      log =
        capture_log(fn ->
          assert {:error, %State.NotArmed{robot: ^rover, actuator: :left_motor}} =
                   Actuator.set_position(rover, :left_motor, 1.0)
        end)

      assert log =~ "refused" and log =~ "left_motor" and log =~ "robot is not armed"

      :ok = Safety.arm(rover)
      assert Runtime.state(rover) == :idle
      {:ok, epoch} = Safety.epoch(rover)
      assert epoch > 0
      {:ok, _} = BB.subscribe(rover, [:sensor, :chassis, :right])
      assert :ok = Actuator.set_position(rover, [:chassis, :right, :right_motor], 1)

      assert_receive {:bb, [:sensor, :chassis, :right, :right_motor], %Message{payload: payload}},
                     60_000

      assert %JointState{names: [:right], positions: [position]} = payload
      assert_in_delta position, 1.0, 1.0e-9
      assert [%Command.Position{position: motor}] = BB.Process.call(rover, :right_motor, :log)
      assert_in_delta motor, -2.0, 1.0e-9
      eventually(fn -> abs(Runtime.configurations(rover).right - 1.0) < 1.0e-9 end)

      :ok = Actuator.set_velocity(rover, :right_motor, 1.5, duration: 100)
      :ok = Actuator.stop(rover, :right_motor, mode: :decelerate)
      :ok = Actuator.hold(rover, :right_motor, delivery: :direct)

      eventually(fn ->
        match?(
          [
            %Command.Hold{},
            %Command.Stop{mode: :decelerate},
            %Command.Velocity{velocity: -3.0},
            _
          ],
          BB.Process.call(rover, :right_motor, :log)
        )
      end)

      assert {:error, %State.UnsupportedCommand{command: Command.Trajectory}} =
               Actuator.follow_trajectory(rover, :left_motor, [[position: 1, time_from_start: 0]],
                 delivery: :pubsub
               )

      :ok =
        Actuator.set_effort(rover, :left_motor, 0.5, delivery: :direct, reply_on_reject?: true)

      refute_received {:bb, :command_rejected, _, _, _}
      id = make_ref()
      :ok = Safety.disarm(rover)
      assert Safety.epoch(rover) == :error

      :ok =
        Actuator.hold(rover, :left_motor,
          delivery: :direct,
          reply_on_reject?: true,
          command_id: id
        )

      assert_receive {:bb, :command_rejected, :left_motor, ^id, %State.NotArmed{}}, 60_000

      error = assert_raise ArgumentError, fn -> Actuator.stop(rover, :nonexistent) end
      assert error.message =~ "has no actuator named :nonexistent"
    end

    test "hears its sensors, each at its rate", %{rover: rover} do
      start(rover, [:battery, :imu])
      assert state_of(rover, :battery).loop.clock == {:rate, 20.0}
      assert state_of(rover, :imu).opts[:rate] == ~u(200 hertz)
      assert state_of(rover, :imu).opts[:address] == 0x68
      {:ok, _} = BB.PubSub.subscribe(rover, [:sensor, :battery], message_types: [PowerState])
      assert_receive {:bb, [:sensor, :battery], %Message{robot: ^rover}}, 60_000
    end

    test "an armed robot whose topology dies is in error", %{rover: rover} do
      start(rover, [:left_motor])
      :ok = Safety.arm(rover)
      {:ok, _} = BB.subscribe(rover, [:state_machine])
      pid = BB.Process.whereis(rover, BB.TopologySupervisor)
      assert is_pid(pid)

      capture_log(fn ->
        Process.exit(pid, :kill)
        eventually(fn -> Safety.in_error?(rover) end)
      end)

      assert_receive {:bb, [:state_machine], %Message{payload: %{to: :error}}}, 60_000
      assert Safety.arm(rover) == {:error, :in_error}
      assert Runtime.state(rover) == :error
      assert Safety.force_disarm(rover) == :ok
      assert Safety.state(rover) == :disarmed
    end
  end

  describe "an arm of six joints" do
    test "has shapes, inertia, limits and dynamics", %{arm: arm} do
      %{links: links, joints: joints, actuators: actuators} = robot = arm.robot()
      assert links.base.mass == 4.0
      assert links.base.center_of_mass == {0.0, 0.0, 0.05}

      assert links.base.inertia == %{
               ixx: 0.02,
               iyy: 0.02,
               izz: 0.03,
               ixy: 0.0,
               ixz: 0.0,
               iyz: 0.0
             }

      assert {{0.0, 0.0, 0.05}, {0.0, 0.0, 0.0}} = links.base.visual.origin
      assert links.base.visual.geometry == {:cylinder, %{radius: 0.08, height: 0.1}}
      assert [%{origin: {{+0.0, +0.0, 0.055}, _}}] = links.base.collisions
      assert links.turret.visual.geometry == {:mesh, %{filename: "turret.stl", scale: 0.001}}
      assert links.upper_arm.visual.geometry == {:capsule, %{radius: 0.04, length: 0.3}}
      assert %{texture: "steel.png", color: nil} = links.upper_arm.visual.material
      assert [:sleeve, :knob] = Enum.map(links.forearm.collisions, & &1.name)
      assert joints.waist.axis == {0.0, 0.0, 1.0}
      assert joints.waist.dynamics == %{damping: 1.0, friction: 0.1}
      assert_in_delta joints.waist.limits.acceleration, 2 * @pi, 1.0e-12
      assert joints.roll.axis == nil and joints.roll.limits == nil
      assert joints.grip.dynamics == %{damping: 3.0, friction: nil}

      assert joints.grip.limits == %{
               lower: 0.0,
               upper: 0.04,
               effort: 20.0,
               velocity: 0.1,
               acceleration: 1.0
             }

      assert {x, _y, _z} = joints.elbow.axis
      assert_in_delta x, 1.0, 1.0e-12
      assert_in_delta actuators.waist_motor.transmission.offset, @pi / 2, 1.0e-12
      assert actuators.grip_motor.transmission.offset == 0.01
      assert actuators.shoulder_right.transmission.reduction == -1.0
      assert robot.sensors.elbow_encoder.attached_to == {:joint, :elbow}
      assert Robot.Topology.max_depth(robot.topology) == 6
      assert {:ok, [:base | _]} = Robot.path_between(robot, :base, :finger)
    end

    test "has commands, categories and states", %{arm: arm} do
      commands = Info.commands(arm)

      assert [%BB.Dsl.Category{name: :motion, concurrency_limit: 1, doc: doc}] =
               Enum.filter(commands, &(&1.name == :motion))

      assert doc == "What moves joints."
      by_name = Map.new(commands, &{&1.name, &1})

      assert %BB.Dsl.Command{handler: BB.Command.Arm, arm: true, allowed_states: [:disarmed]} =
               by_name.arm

      assert %{disarm: true, allowed_states: :*, cancel: :*, timeout: :infinity} =
               normal(by_name.disarm)

      assert %{handler: {BB.Command.SetState, to: :parked}, category: :motion} = by_name.park

      assert %{timeout: 5_000, cancel: [:sensing], allowed_states: [:idle, :parked]} =
               by_name.reach

      assert [speed, mode, target] = by_name.reach.arguments

      assert %BB.Dsl.Command.Argument{name: :speed, type: :float, required: false, default: 0.5} =
               speed

      assert %{type: {:in, [:fast, :slow]}, required: true, default: nil} = mode
      assert target.doc == "A name."
      assert Enum.sort(Info.state_names(arm)) == [:disarmed, :homing, :idle, :parked]
      assert Enum.sort(arm.__bb_state_names__()) == [:disarmed, :homing, :idle, :parked]
      assert arm.__bb_initial_state__() == :idle
      assert arm.__bb_arm_command__() == :arm and arm.__bb_disarm_command__() == :disarm
      assert %{motion: 1, sensing: 3, default: 1} = Map.new(arm.__bb_category_limits__())
    end

    test "its motors have profiles in their own space", %{arm: arm} do
      start(arm, [:waist_motor, :grip_motor, :shoulder_right, :bend_motor])
      profile = state_of(arm, :waist_motor).profile
      assert_in_delta profile.motor_velocity_limit, 25 * @pi, 1.0e-9
      assert profile.motor_lower < profile.motor_upper

      assert_in_delta profile.motor_initial_position,
                      (profile.motor_lower + profile.motor_upper) / 2,
                      1.0e-9

      assert %{motor_lower: nil, motor_upper: nil, motor_initial_position: 0.0} =
               state_of(arm, :bend_motor).profile

      assert_in_delta state_of(arm, :shoulder_right).profile.motor_upper, @pi / 2, 1.0e-12

      assert BB.Safety.Controller.registered_handlers(arm) |> Enum.uniq() == [
               BB.Test.BeamBots.Motor
             ]
    end

    defp normal(%{allowed_states: states, cancel: cancel} = command) do
      unlist = &if(&1 == [:*], do: :*, else: &1)
      %{command | allowed_states: unlist.(states), cancel: unlist.(cancel)}
    end
  end

  describe "a pan-tilt on servos without feedback" do
    test "gives names to what has none", %{pan_tilt: pan_tilt} do
      robot = pan_tilt.robot()
      assert Info.settings_name(pan_tilt) == {:ok, :pan_tilt}
      assert Enum.sort(Map.keys(robot.links)) == [:camera, :lamp, :link_0, :link_1, :link_2]
      assert Enum.sort(Map.keys(robot.joints)) == [:joint_0, :joint_1, :pan, :tilt]
      assert robot.root_link == :link_0

      assert [%{name: :link_0, joints: [%{name: :pan, link: %{name: :link_1}}]}] =
               Info.topology(pan_tilt)
    end

    test "reckons where it is", %{pan_tilt: pan_tilt} do
      start(pan_tilt, [:pan_servo, :tilt_servo, :pan_estimator, :tilt_estimator])
      estimator = state_of(pan_tilt, :tilt_estimator)

      assert %{easing: :ease_in_out_quad, publish_interval_ms: 10, max_silence_ms: 2000} =
               estimator

      assert %{joint_name: :tilt, actuator: :tilt_servo} = estimator
      assert state_of(pan_tilt, :pan_estimator).publish_interval_ms == 20
      {:ok, _} = BB.subscribe(pan_tilt, [:actuator])
      {:ok, _} = BB.subscribe(pan_tilt, [:sensor])
      :ok = Safety.arm(pan_tilt)
      assert :ok = Actuator.set_position(pan_tilt, :tilt_servo, 0.5)
      path = [:actuator, :link_0, :pan, :link_1, :tilt, :tilt_servo]

      assert_receive {:bb, ^path, %Message{payload: %BeginMotion{} = motion, frame_id: :tilt}},
                     60_000

      assert_in_delta motion.target_position, 0.5, 1.0e-9
      assert_receive {:bb, [:sensor | rest], %Message{payload: %JointState{} = state}}, 60_000
      assert List.last(rest) == :tilt_estimator
      assert state.names == [:tilt]
      assert_in_delta hd(state.positions), 0.5, 1.0e-9
      eventually(fn -> abs(Runtime.configurations(pan_tilt).tilt - 0.5) < 1.0e-9 end)
      assert Runtime.configurations(pan_tilt).pan == 0.0
    end

    test "moves in simulation", %{pan_tilt: pan_tilt} do
      start(pan_tilt, [:pan_servo, :pan_estimator], simulation: :kinematic)
      assert Runtime.simulation_mode(pan_tilt) == :kinematic
      :ok = Safety.arm(pan_tilt)
      assert :ok = Actuator.set_position(pan_tilt, :pan_servo, 9.0)
      eventually(fn -> abs(Runtime.configurations(pan_tilt).pan - @pi / 2) < 1.0e-9 end)
    end
  end

  describe "a leg with mimic joints" do
    test "moves the joints that follow", %{leg: leg} do
      start(leg, [:knee_encoder, :knee_spare, :rod_mimic, :ankle_mimic])
      {:ok, _} = BB.subscribe(leg, [:sensor, :hip, :rod])
      {:ok, _} = BB.subscribe(leg, [:sensor, :hip, :ankle])

      for {encoder, angle} <- [knee_encoder: 1.0, knee_spare: 0.5] do
        BB.Process.cast(leg, encoder, {:angle, angle})
        assert_receive {:bb, [:sensor, :hip, :rod, :rod_mimic], rod}, 60_000
        assert_receive {:bb, [:sensor, :hip, :ankle, :ankle_mimic], ankle}, 60_000
        assert %{frame_id: :knee, payload: %JointState{names: [:rod]} = payload} = rod
        assert payload.positions == [-angle]
        assert ankle.payload.names == [:ankle]
        assert ankle.payload.positions == [angle * 0.5 + 0.25]
      end

      eventually(fn -> match?(%{rod: -0.5, ankle: 0.5}, Runtime.configurations(leg)) end)
    end
  end

  describe "a robot with parameters" do
    setup do
      file = Path.join(System.tmp_dir!(), "bb_tuned.dets")
      File.rm(file)
      on_exit(fn -> File.rm(file) end)
    end

    test "has nil for each reference, and says where they are", %{tuned: tuned} do
      robot = tuned.robot()
      assert robot.links.base.mass == nil
      mast = robot.joints.mast
      assert mast.axis == nil
      assert {+0.0, +0.0, nil} = mast.origin.position
      assert %{upper: nil, velocity: nil, effort: 10.0} = mast.limits
      assert mast.dynamics == %{damping: nil, friction: nil}
      transmission = robot.actuators.mast_motor.transmission
      assert transmission == %{reduction: nil, offset: nil, reversed?: nil}
      subscriptions = robot.param_subscriptions
      assert subscriptions[[:motion, :top]] == [{:joint, :mast, [:limits, :upper]}]
      assert subscriptions[[:motion, :damping]] == [{:joint, :mast, [:dynamics, :damping]}]
      assert subscriptions[[:body, :height]] == [{:joint, :mast, [:origin, :z]}]
      assert subscriptions[[:body, :tilt]] == [{:joint, :mast, [:axis, :pitch]}]

      assert subscriptions[[:motion, :gear, :ratio]] ==
               [{:actuator, :mast_motor, [:transmission, :reduction]}]
    end

    test "has its parameters as written and flat", %{tuned: tuned} do
      assert [:rate, :label, :pin, :mode, :motion, :body] =
               Enum.map(Info.parameters(tuned), & &1.name)

      assert %BB.Dsl.ParamGroup{doc: "Its masses.", params: [_, _, _], groups: []} =
               List.last(Info.parameters(tuned))

      assert %{topology_max_restarts: 10, topology_max_seconds: 60} = Info.settings(tuned)
      schema = Map.new(tuned.__bb_parameter_schema__())

      assert {:custom, BB.Parameter.Type, :validate_bounds, [_]} =
               schema[[:motion, :gear, :ratio]][:type]

      assert {:custom, BB.Unit.Option, :validate, [opts]} = schema[[:motion, :top]][:type]
      assert opts[:compatible] == :degree
      defaults = Map.new(tuned.__bb_default_parameters__())
      assert defaults[[:motion, :top]] == ~u(90 degree)
      refute Map.has_key?(defaults, [:label])
    end

    test "follows its parameters while it runs", %{tuned: tuned} do
      start(tuned, [:gauge, :mast_motor])
      robot = Runtime.get_robot(tuned)
      assert robot.links.base.mass == 2.0
      assert_in_delta robot.joints.mast.limits.upper, @pi / 2, 1.0e-12
      assert {x, _, _} = robot.joints.mast.axis
      assert_in_delta x, 1.0, 1.0e-12
      assert robot.actuators.mast_motor.transmission.reduction == 4.0
      assert state_of(tuned, :mast_motor).opts[:frequency] == ~u(50 hertz)

      {:ok, _} = BB.subscribe(tuned, [:param])
      :ok = Parameter.set(tuned, [:motion, :top], ~u(1 radian))
      assert_receive {:bb, [:param, :motion, :top], %Message{payload: changed}}, 60_000
      assert %{old_value: ~u(90 degree), source: :local} = changed
      assert changed.new_value.name == "degree"
      assert_in_delta Runtime.get_robot(tuned).joints.mast.limits.upper, 1.0, 1.0e-9

      :ok =
        Parameter.set_many(tuned, [{[:motion, :gear, :ratio], 10.0}, {[:rate], ~u(100 hertz)}])

      eventually(fn -> state_of(tuned, :gauge).loop.clock == {:rate, 100.0} end)
      assert Runtime.get_robot(tuned).actuators.mast_motor.transmission.reduction == 10.0
      :ok = Safety.arm(tuned)
      :ok = Parameter.set(tuned, [:motion, :gear, :zero], ~u(0 degree))
      assert :ok = Actuator.set_position(tuned, :mast_motor, 0.1)
      assert [%{position: position} | _] = BB.Process.call(tuned, :mast_motor, :log)
      assert_in_delta position, 1.0, 1.0e-9

      assert {:error, _} = Parameter.set(tuned, [:motion, :top], ~u(1 meter))
      assert {:error, _} = Parameter.set(tuned, [:motion, :top], ~u(181 degree))
      assert {:error, _} = Parameter.set(tuned, [:motion, :gear, :ratio], 10)
      assert {:error, :not_found} = Parameter.get(tuned, [:label])
      :ok = Parameter.set(tuned, [:pin], nil)
      :ok = Parameter.set(tuned, [:pin], 4)
      assert {:error, _} = Parameter.set(tuned, [:pin], -4)
      assert_raise ArgumentError, ~r/parameter not found/, fn -> Parameter.get!(tuned, [:x]) end
    end

    test "keeps them in its store", %{tuned: tuned} do
      start(tuned, [:mast_motor])
      :ok = Parameter.set(tuned, [:motion, :gear, :ratio], 7.5)
      :ok = Parameter.set(tuned, [:label], "mast")
      :ok = stop_supervised!(tuned)

      start(tuned, [:mast_motor],
        params: [label: "boom", motion: [speed: ~u(1 radian_per_second)]]
      )

      assert Parameter.get(tuned, [:motion, :gear, :ratio]) == {:ok, 7.5}
      assert Parameter.get(tuned, [:label]) == {:ok, "boom"}
      assert_in_delta Runtime.get_robot(tuned).joints.mast.limits.velocity, 1.0, 1.0e-9
    end

    test "refuses wrong parameters at the start", %{tuned: tuned} do
      Process.flag(:trap_exit, true)

      for params <- [[nope: 1], [motion: [nope: 1]], [motion: [gear: [ratio: 500.0]]]] do
        assert {:error, error} = tuned.start_link(params: params)
        assert Exception.message(error) =~ ~r/nope|at most 100.0, got: 500.0/
      end
    end
  end

  describe "the smallest robots" do
    test "start", %{nothing: nothing, one_link: one_link, station: station} do
      for robot <- [nothing, one_link, station] do
        start(robot, [], params: [])
        assert :ok = Safety.arm(robot)
        assert Runtime.state(robot) == :idle
        assert :ok = Safety.disarm(robot)
      end

      assert Info.topology(nothing) == []
      assert Info.states(nothing) != nil and Info.state_names(nothing) == [:idle]
      assert Info.initial_state(nothing) == :idle
      assert Map.new(Info.category_limits(nothing)) == %{default: 1}
      assert nothing.__bb_arm_command__() == nil
      assert Info.commands(nothing) == [] and Info.parameters(nothing) == []
      assert one_link.robot().root_link == :base
      assert one_link.robot().joints == %{}
      assert Robot.joints_in_order(one_link.robot()) == []
      assert Parameter.get(station, [:interval]) == {:ok, 10}
      assert {:ok, _} = Keyword.fetch(station.__bb_parameter_schema__() |> hd() |> elem(1), :type)
      assert Info.settings_registry_module(nothing) == {:ok, Registry}
      assert Info.settings_parameter_store(nothing) in [:error, {:ok, nil}]
    end
  end

  describe "a barge" do
    test "has a floating and a planar joint", %{barge: barge} do
      robot = barge.robot()
      assert %{type: :floating, axis: nil, limits: nil, dynamics: nil} = robot.joints.float
      deck = robot.joints.deck
      assert %{type: :planar, axis: {+0.0, +0.0, 1.0}} = deck

      assert deck.limits == %{
               lower: nil,
               upper: nil,
               effort: 10.0,
               velocity: 1.0,
               acceleration: nil
             }

      assert Enum.map(Robot.joints_in_order(robot), &Robot.Joint.dof/1) == [6, 3]

      assert [%BB.Dsl.Bridge{name: :shore, simulation: :mock}, %{name: :depth}] =
               Info.parameters(barge)

      assert [:start, :omit] =
               barge |> Info.controllers() |> Enum.slice(1, 2) |> Enum.map(& &1.simulation)

      {:ok, state} = Robot.State.new(robot)
      assert Robot.State.get_configuration(state, :deck) == {:ok, Transform2D.identity()}
      assert Robot.State.get_configuration(state, :float) == {:ok, Transform.identity()}

      assert {:error, %BB.Error.Invalid.JointConfig{joint: :deck, field: :configuration}} =
               Robot.State.set_configuration(state, :deck, 1.0)
    end

    test "follows its poses", %{barge: barge} do
      start(barge, [:tug])
      pose = Transform2D.new(1, 2, 0.5)
      attrs = [names: [:deck, :nope], positions: [pose, 1.0], velocities: [], efforts: []]
      message = Message.new!(JointState, :deck, attrs)
      :ok = BB.publish(barge, [:sensor, :camera], message)
      eventually(fn -> Runtime.configurations(barge).deck == pose end)
      assert Runtime.configurations(barge).float == Transform.identity()
    end

    test "acts on what its sensors say", %{barge: barge} do
      start(barge, [:watch, :low, :never, :orders, :power])
      {:ok, _} = BB.subscribe(barge, [:seen])
      assert_receive {:bb, [:seen, :watch], %Message{payload: %PowerState{}}}, 60_000
      assert_receive {:bb, [:seen, :low], %Message{payload: %PowerState{}}}, 60_000
      assert %{opts: opts, last_triggered: :never} = state_of(barge, :never)
      assert opts[:cooldown_ms] == 1000 and is_function(opts[:match], 1)
      assert opts[:action] == %BB.Controller.Action.Command{command: :disarm, args: []}
      assert state_of(barge, :orders).opts[:action].args == [speed: 1.0]
    end
  end
end
