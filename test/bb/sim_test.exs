defmodule BB.SimTest do
  @moduledoc "A robot that is started with `simulation:`."

  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Actuator.MotorProfile
  alias BB.Message.Actuator.BeginMotion
  alias BB.Sim.Motion

  doctest Motion
  doctest BB.Robot.SimulationMode

  defmodule Hardware do
    @moduledoc "An actuator that fails a test in which it runs."
    use BB.Actuator, options_schema: [channel: [type: :integer, required: true]]

    @impl BB.Actuator
    def init(opts), do: raise("#{inspect(opts[:bb].path)} runs")

    @impl BB.Actuator
    def disarm(_opts), do: :ok

    @impl BB.Actuator
    def handle_command(_message, state), do: {:noreply, state}

    @impl BB.Actuator
    def capabilities(_opts), do: [:position_feedback]
  end

  setup do
    robot =
      robot do
        controllers do
          controller :omitted, BB.Test.Brain
          controller :mocked, {BB.Test.Brain, rate: 2}, simulation: :mock
          controller :started, BB.Test.Brain, simulation: :start
        end

        sensors do
          sensor :battery, BB.Test.Probe
        end

        topology do
          link :base do
            joint :elbow do
              type :revolute

              limit lower: ~u(-90 degree),
                    upper: ~u(90 degree),
                    effort: ~u(1 newton_meter),
                    velocity: ~u(20 radian_per_second),
                    acceleration: ~u(200 radian_per_square_second)

              actuator :servo, {BB.SimTest.Hardware, channel: 1} do
                transmission reduction: -2.0, offset: ~u(0.5 radian)
              end

              link :arm do
                joint :wrist do
                  type :continuous
                  actuator :spinner, {BB.SimTest.Hardware, channel: 2}

                  sensor :own_estimator,
                         {BB.Sensor.OpenLoopPositionEstimator, actuator: :spinner}

                  link :hand
                end
              end
            end
          end
        end
      end

    %{robot: robot}
  end

  defp start(robot, mode \\ :kinematic) do
    start_supervised!(%{id: robot, start: {robot, :start_link, [[simulation: mode]]}})
    assert await_all_up(robot)
    robot
  end

  @topic [:actuator, :base, :elbow, :servo]

  test "has simulated actuators, real sensors, and controllers as they declare", %{robot: robot} do
    for mode <- [:kinematic, :external] do
      start(robot, mode)
      assert BB.Robot.Runtime.simulation_mode(robot) == mode
      modules = for row <- BB.Actuator.health(robot), do: {row.name, row.module}
      assert modules == [servo: BB.Sim.Actuator, spinner: BB.Sim.Actuator]

      assert for(row <- BB.Controller.health(robot), do: {row.name, row.module}) ==
               [mocked: BB.Sim.Controller, started: BB.Test.Brain]

      assert BB.Process.whereis(robot, :omitted) == :undefined
      assert BB.Process.call(robot, :mocked, :anything) == :ok
      assert [_ | _] = BB.Process.call(robot, :started, :options)

      assert for(row <- BB.Sensor.health(robot), do: row.name) ==
               [:battery, :servo_position_estimator, :own_estimator]

      stop_supervised!(robot)
    end
  end

  test "moves: commands, announced motions and positions agree, in the joint's space", %{
    robot: robot
  } do
    start(robot)
    {:ok, _} = BB.subscribe(robot, [:actuator], message_types: [BeginMotion])
    :ok = BB.Safety.arm(robot)
    id = make_ref()
    :ok = BB.Actuator.set_position(robot, :servo, 1.0, command_id: id)

    assert_receive {:bb, @topic, %{frame_id: :elbow, payload: %BeginMotion{} = motion}}
    assert_in_delta motion.initial_position, 0.0, 1.0e-9
    assert_in_delta motion.target_position, 1.0, 1.0e-9
    assert motion.command_type == :position
    assert motion.command_id == id
    assert_in_delta motion.acceleration, 200.0, 1.0e-9
    assert_in_delta motion.peak_velocity, :math.sqrt(200.0), 1.0e-9

    assert eventually(fn ->
             abs(BB.Robot.Runtime.configurations(robot).elbow - 1.0) < 1.0e-9
           end)

    :ok = BB.Actuator.set_position(robot, :servo, 9.0)
    assert_receive {:bb, @topic, %{payload: %BeginMotion{} = motion}}
    assert_in_delta motion.initial_position, 1.0, 1.0e-9
    assert_in_delta motion.target_position, :math.pi() / 2, 1.0e-9

    :ok = BB.Actuator.hold(robot, :servo)
    :ok = BB.Actuator.set_velocity(robot, :servo, 1.0, delivery: :pubsub)
    refute_received {:bb, @topic, %{payload: %BeginMotion{}}}
    assert BB.Process.whereis(robot, :servo) != :undefined
  end

  test "refuses commands while it is not armed", %{robot: robot} do
    start(robot)
    assert {:error, %BB.Error.State.NotArmed{}} = BB.Actuator.set_position(robot, :servo, 1.0)
  end

  test "is no simulation any more when it starts again without the option", %{robot: robot} do
    start(robot)
    stop_supervised!(robot)
    ExUnit.CaptureLog.capture_log(fn -> start_supervised!(robot) end)
    assert BB.Robot.Runtime.simulation_mode(robot) == nil
    assert [%{module: Hardware} | _] = BB.Actuator.health(robot)
    assert for(row <- BB.Controller.health(robot), do: row.name) == [:omitted, :mocked, :started]
    stop_supervised!(robot)
    assert {:error, %BB.Options.ValidationError{}} = robot.start_link(simulation: :dream)
  end

  test "BB.Process.child_spec/5,6 starts a component, simulated or not", %{robot: robot} do
    start(robot)
    spec = BB.Process.child_spec(robot, :extra, {BB.Test.Probe, rate: 3}, [:base], :sensor)
    pid = start_supervised!(spec)
    assert BB.Process.whereis(robot, :extra) == pid
    assert :sys.get_state(pid).user_state == %{robot: robot, path: [:base, :extra]}

    for {kind, server} <- [actuator: BB.Actuator.Server, controller: BB.Controller.Server] do
      spec = BB.Process.child_spec(robot, :x, Some.Module, [], kind)
      assert %{id: :x, start: {^server, :start_link, [args, [name: _via]]}} = spec
      assert args == [__callback_module__: Some.Module, bb: %{robot: robot, path: [:x]}]
    end

    opts = [simulation: :kinematic]
    child = {Hardware, channel: 7}
    spec = BB.Process.child_spec(robot, :more, child, [:base, :elbow], :actuator, opts)
    assert :sys.get_state(start_supervised!(spec)).module == BB.Sim.Actuator
    spec = BB.Process.child_spec(robot, :x, Some.Module, [], :sensor, opts)
    assert {BB.Sensor.Server, :start_link, [[{_, Some.Module} | _], _]} = spec.start
  end

  describe "a motion" do
    property "keeps to the limits of the motor, and ends at its target" do
      forall {from, to, lower, range, velocity, acceleration, part} <-
               {float(-10.0, 10.0), float(-20.0, 20.0), float(-10.0, 0.0), float(0.0, 10.0),
                float(0.1, 10.0), oneof([nil, float(0.1, 10.0)]), float(0.0, 1.0)} do
        profile = %MotorProfile{
          motor_lower: lower,
          motor_upper: lower + range,
          motor_velocity_limit: velocity,
          motor_acceleration_limit: acceleration
        }

        motion = Motion.plan(from, to, profile, 100)
        assert motion.to >= lower and motion.to <= lower + range
        if to >= lower and to <= lower + range, do: assert(motion.to == to)
        assert Motion.position(motion, 100 + motion.duration_ms) == motion.to

        distance = abs(motion.to - from)
        assert motion.duration_ms + 1 >= distance / velocity * 1_000
        assert motion.peak_velocity == nil or motion.peak_velocity <= velocity

        between = Motion.position(motion, 100 + floor(part * motion.duration_ms))
        [low, high] = Enum.sort([from, motion.to])
        assert between >= low - 1.0e-6 and between <= high + 1.0e-6
        true
      end
    end

    test "is a triangle where the way is short, and its velocity constant without acceleration" do
      limits = %MotorProfile{motor_velocity_limit: 2.0, motor_acceleration_limit: 1.0}
      motion = Motion.plan(0.0, -1.0, limits, 0)
      assert {motion.peak_velocity, motion.duration_ms, motion.acceleration} == {1.0, 2_000, 1.0}
      motion = Motion.plan(0.0, 8.0, limits, 0)
      assert {motion.peak_velocity, motion.duration_ms} == {2.0, 6_000}

      motion = Motion.plan(0.0, 8.0, %{limits | motor_acceleration_limit: nil}, 0)
      assert {motion.peak_velocity, motion.acceleration, motion.duration_ms} == {nil, nil, 4_000}
      assert Motion.position(motion, 1_000) == 2.0

      assert %{duration_ms: 0, to: 8.0} = Motion.plan(0.0, 8.0, %MotorProfile{}, 0)
      assert %{duration_ms: 0} = Motion.plan(8.0, 8.0, limits, 0)
    end
  end
end
