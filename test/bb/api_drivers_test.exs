defmodule BB.ApiDriversTest do
  @moduledoc """
  A robot with the parts of the servo drivers for Beam Bots: a controller that drives a chip,
  servos that call it in `init/1` and `disarm/1`, and no sensor but an estimator.
  """

  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Error.State.{NotArmed, UnsupportedCommand}
  alias BB.Message.Sensor.JointState

  defmodule Chip do
    use BB.Controller, options_schema: [bus: [type: :string, required: true]]

    @impl BB.Controller
    def init(opts), do: {:ok, %{bb: opts[:bb], pulses: %{}}}

    @impl BB.Controller
    def handle_call({:pulse, channel, width_us}, _from, state),
      do: {:reply, :ok, put_in(state.pulses[channel], width_us)}

    def handle_call(:pulses, _from, state), do: {:reply, state.pulses, state}
  end

  defmodule Servo do
    use BB.Actuator

    import BB.Unit
    import BB.Unit.Option

    alias BB.Message.Actuator.Command

    @middle_us 1500

    defstruct [:bb, :opts, :profile, frequency: ~u(50hertz)]

    @impl BB.Actuator
    def options_schema do
      BB.Options.new!(
        channel: [type: {:in, 0..15}, required: true],
        controller: [type: :atom, required: true],
        frequency: [
          type: unit_type(compatible: :hertz, min: ~u(40 hertz), max: ~u(1 kilohertz)),
          default: ~u(50 hertz)
        ],
        pin: [type: {:or, [:non_neg_integer, nil]}, default: nil]
      )
    end

    @impl BB.Actuator
    def init(opts) do
      %{robot: robot, path: path} = bb = opts[:bb]
      safe = [robot: robot, channel: opts[:channel], controller: opts[:controller]]

      with %{motor_lower: lower, motor_upper: upper} when lower < upper <- opts[:motor_profile],
           :ok <- pulse(robot, opts, @middle_us) do
        BB.Safety.register(__MODULE__, robot: robot, path: path, opts: safe)
        {:ok, %__MODULE__{bb: bb, opts: opts, profile: opts[:motor_profile]}}
      else
        _other -> {:stop, %BB.Error.Invalid.JointConfig{joint: List.last(path), field: :limits}}
      end
    end

    @impl BB.Actuator
    def disarm(opts), do: pulse(opts[:robot], opts, 0)

    @impl BB.Actuator
    def command_payloads(_opts), do: [Command.Position, Command.Stop]

    @impl BB.Actuator
    def handle_command(%BB.Message{payload: %Command.Position{} = command}, state) do
      :ok = pulse(state.bb.robot, state.opts, round(@middle_us + 100 * command.position))

      BB.Actuator.publish_begin_motion(state.bb.robot, state.bb.path,
        initial_position: 0.0,
        target_position: command.position,
        expected_arrival: System.monotonic_time(:millisecond),
        command_id: command.command_id,
        command_type: :position
      )

      {:noreply, state}
    end

    def handle_command(_stop, state), do: {:reply, {:error, :no_brake}, state}

    defp pulse(robot, opts, width_us),
      do: BB.Process.call(robot, opts[:controller], {:pulse, opts[:channel], width_us})
  end

  setup do
    robot =
      robot do
        import BB.Unit
        import BB.Dsl.ParamRef

        parameters do
          param :channel, type: :integer, default: 3
        end

        controllers do
          controller :chip, {BB.ApiDriversTest.Chip, bus: "i2c-1"}, simulation: :mock
        end

        topology do
          link :base do
            joint :pan do
              type :revolute

              limit do
                lower ~u(-90 degree)
                upper ~u(90 degree)
                effort ~u(1 newton_meter)
                velocity ~u(60 degree_per_second)
              end

              actuator :servo,
                       {BB.ApiDriversTest.Servo, channel: param([:channel]), controller: :chip} do
                transmission reduction: -2.0
              end

              sensor :position, {BB.Sensor.OpenLoopPositionEstimator, actuator: :servo}
              link :head
            end
          end
        end
      end

    %{robot: robot}
  end

  defp start(robot) do
    start_supervised!(robot)
    assert eventually(fn -> BB.Process.call(robot, :chip, :pulses) == %{3 => 1500} end)
    assert await_all_up(robot)
  end

  test "the controller is there when a servo starts and when it is made safe", %{robot: robot} do
    start(robot)
    assert :ok = BB.Safety.arm(robot)
    assert :ok = BB.Actuator.set_position(robot, :servo, 0.5)
    assert BB.Process.call(robot, :chip, :pulses) == %{3 => 1400}
    assert :ok = BB.Safety.disarm(robot)
    assert BB.Process.call(robot, :chip, :pulses) == %{3 => 0}
  end

  test "a command becomes a motion, which becomes the joint's position", %{robot: robot} do
    start(robot)
    assert :ok = BB.Safety.arm(robot)
    path = [:base, :pan, :servo]
    topic = [:actuator | path]
    {:ok, _} = BB.subscribe(robot, topic, message_types: [BB.Message.Actuator.BeginMotion])
    {:ok, _} = BB.subscribe(robot, [:sensor])
    id = make_ref()
    assert :ok = BB.Actuator.set_position(robot, path, 1, command_id: id)

    assert_receive {:bb, ^topic, %{frame_id: :pan, payload: %{command_id: ^id} = motion}}
    assert motion.target_position == 1.0

    assert_receive {:bb, [:sensor, :base, :pan, :position],
                    %{frame_id: :position, payload: %JointState{} = state}}

    assert %{names: [:pan], positions: [1.0]} = state
    assert eventually(fn -> BB.Robot.Runtime.configurations(robot) == %{pan: 1.0} end)
  end

  test "a servo refuses what it does not declare, and answers for itself", %{robot: robot} do
    start(robot)
    ref = make_ref()
    opts = [delivery: :direct, reply_on_reject?: true, command_id: ref]
    assert {:error, %NotArmed{actuator: :servo}} = BB.Actuator.set_position(robot, :servo, 0.5)
    assert :ok = BB.Actuator.stop(robot, :servo, opts)
    assert_receive {:bb, :command_rejected, :servo, ^ref, %NotArmed{robot: ^robot}}

    assert :ok = BB.Safety.arm(robot)
    hold = BB.Actuator.hold(robot, :servo, delivery: :pubsub)
    assert {:error, %UnsupportedCommand{actuator: :servo, supported: [_, _]}} = hold
    assert {:error, :no_brake} = BB.Actuator.stop(robot, :servo, delivery: :pubsub)
    assert {:ok, :accepted} = BB.Actuator.set_position_sync(robot, :servo, 0.0)

    assert_raise ArgumentError, ~r/has no actuator named :nonexistent/, fn ->
      BB.Actuator.set_position(robot, :nonexistent, 0.5)
    end
  end

  test "a simulation has neither the chip nor the driver", %{robot: robot} do
    start_supervised!({robot, simulation: :kinematic})
    assert BB.Robot.Runtime.simulation_mode(robot) == :kinematic
    assert BB.Process.call(robot, :chip, :pulses) == :ok
    assert BB.Process.whereis(robot, :servo_position_estimator) == :undefined
    assert await_all_up(robot)
    assert :ok = BB.Safety.arm(robot)
    assert :ok = BB.Actuator.set_position(robot, :servo, 0.1)
    assert eventually(fn -> BB.Robot.Runtime.configurations(robot).pan == 0.1 end)
  end

  @registered [
    BB.TopologySupervisor,
    BB.SensorSupervisor,
    BB.ControllerSupervisor,
    BB.BridgeSupervisor,
    BB.CommandSupervisor,
    BB.TaskSupervisor,
    BB.Robot.Runtime
  ]

  test "the supervisors have their names", %{robot: robot} do
    start(robot)

    for name <- @registered,
        do: assert({name, true} == {name, is_pid(BB.Process.whereis(robot, name))})

    task = Task.Supervisor.async(BB.Process.via(robot, BB.TaskSupervisor), fn -> self() end)
    assert is_pid(Task.await(task))
    assert :ok = Supervisor.terminate_child(robot, BB.TopologySupervisor)
    assert {:ok, topology} = Supervisor.restart_child(robot, BB.TopologySupervisor)
    assert BB.Process.whereis(robot, BB.TopologySupervisor) == topology
  end
end
