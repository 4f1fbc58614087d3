# Drivers as users of Beam Bots write them, for the robots of this directory.
defmodule BB.Test.BeamBots.Motor do
  @moduledoc "A motor with an encoder: each command is where it stands at once."
  use BB.Actuator
  import BB.Unit
  import BB.Unit.Option

  alias BB.Message
  alias BB.Message.Actuator.Command.{Effort, Hold, Position, Stop, Velocity}
  alias BB.Message.Sensor.JointState

  @impl BB.Actuator
  def options_schema do
    BB.Options.new!(
      channel: [type: {:in, 0..15}, required: true],
      frequency: [
        type: unit_type(compatible: :hertz, min: ~u(1 hertz), max: ~u(1 kilohertz)),
        default: ~u(50 hertz)
      ]
    )
  end

  @impl BB.Actuator
  def capabilities(_opts), do: [:position_feedback]

  @impl BB.Actuator
  def command_payloads(_opts), do: [Position, Velocity, Effort, Stop, Hold]

  @impl BB.Actuator
  def init(opts) do
    bb = Keyword.fetch!(opts, :bb)
    BB.Safety.register(__MODULE__, robot: bb.robot, path: bb.path, opts: opts)
    joint = Enum.at(bb.path, -2)
    name = List.last(bb.path)
    {:ok, %{bb: bb, joint: joint, name: name, opts: opts, profile: opts[:motor_profile], log: []}}
  end

  @impl BB.Actuator
  def disarm(_opts), do: :ok

  @impl BB.Actuator
  def handle_command(%Message{payload: %Position{position: position}} = message, state) do
    attrs = [names: [state.joint], positions: [position], velocities: [0.0], efforts: [0.0]]
    message_out = Message.new!(JointState, state.joint, attrs)
    message_out = BB.Actuator.to_joint_space(state.bb.robot, state.bb.path, message_out)
    BB.publish(state.bb.robot, [:sensor | state.bb.path], message_out)
    {:noreply, %{state | log: [message.payload | state.log]}}
  end

  def handle_command(%Message{payload: payload}, state),
    do: {:reply, :done, %{state | log: [payload | state.log]}}

  @impl BB.Actuator
  def handle_call(:log, _from, state), do: {:reply, state.log, state}
end

defmodule BB.Test.BeamBots.Servo do
  @moduledoc "A servo without feedback. It announces its motions."
  use BB.Actuator,
    options_schema: [pin: [type: :pos_integer, required: true, doc: "The GPIO."]]

  alias BB.Message.Actuator.Command.Position

  @impl BB.Actuator
  def disarm(_opts), do: :ok

  @impl BB.Actuator
  def command_payloads(_opts), do: [Position]

  @impl BB.Actuator
  def init(opts) do
    %{bb: bb, motor_profile: profile} = Map.new(opts)
    {:ok, %{bb: bb, profile: profile, position: profile.motor_initial_position}}
  end

  @impl BB.Actuator
  def handle_command(%BB.Message{payload: %Position{position: position} = command}, state) do
    arrival = System.monotonic_time(:millisecond)

    BB.Actuator.publish_begin_motion(state.bb.robot, state.bb.path,
      initial_position: state.position,
      target_position: position,
      expected_arrival: arrival,
      command_id: command.command_id,
      command_type: :position
    )

    {:noreply, %{state | position: position}}
  end
end

defmodule BB.Test.BeamBots.Ticker do
  @moduledoc "A sensor that publishes at a rate."
  use BB.Sensor
  import BB.Unit
  import BB.Unit.Option

  alias BB.Message.Sensor.PowerState

  @impl BB.Sensor
  def options_schema do
    BB.Options.new!(
      rate: [type: unit_type(compatible: :hertz), default: ~u(100 hertz)],
      address: [type: :integer, default: 0x40]
    )
  end

  @impl BB.Sensor
  def init(opts) do
    loop = BB.Loop.new(opts[:bb], clock: {:rate, opts[:rate]})
    {:ok, %{bb: opts[:bb], opts: opts, loop: BB.Loop.arm(loop)}}
  end

  @impl BB.Sensor
  def handle_info(:tick, state) do
    {_dt, _skipped, loop} = BB.Loop.tick(state.loop)
    name = List.last(state.bb.path)
    message = BB.Message.new!(PowerState, name, voltage: 12.0, current: 1.0, power: 12.0)
    BB.publish(state.bb.robot, [:sensor | state.bb.path], message)
    {:noreply, %{state | loop: loop}}
  end

  def handle_info(_message, state), do: {:noreply, state}

  @impl BB.Sensor
  def handle_options(opts, state) do
    loop = BB.Loop.cancel(state.loop)
    loop = %{loop | clock: BB.Loop.new(opts[:bb], clock: {:rate, opts[:rate]}).clock}
    {:ok, %{state | opts: opts, loop: BB.Loop.arm(loop)}}
  end
end

defmodule BB.Test.BeamBots.Encoder do
  @moduledoc "A sensor that publishes the angles it is cast."
  use BB.Sensor

  @impl BB.Sensor
  def init(opts), do: {:ok, %{bb: opts[:bb], joint: Enum.at(opts[:bb].path, -2)}}

  @impl BB.Sensor
  def handle_cast({:angle, angle}, %{bb: bb, joint: joint} = state) do
    attrs = [names: [joint], positions: [angle], velocities: [1.0], efforts: [0.0]]
    :ok = BB.Sensor.publish_joint_state(bb.robot, bb.path, attrs)
    {:noreply, state}
  end
end

defmodule BB.Test.BeamBots.Mixer do
  @moduledoc "A controller that answers calls, as a bus that servos share."
  use BB.Controller, options_schema: [bus: [type: :string, default: "/dev/ttyS0"]]

  @impl BB.Controller
  def init(opts), do: {:ok, %{opts: opts}}

  @impl BB.Controller
  def handle_call(:bus, _from, state), do: {:reply, {:ok, state.opts[:bus]}, state}
end

defmodule BB.Test.BeamBots.Matcher do
  @moduledoc "Functions of a robot's controllers."
  def high?(%BB.Message{payload: %{voltage: voltage}}), do: voltage > 1.0

  def handle(message, context) do
    BB.publish(context.robot_module, [:seen, context.controller_name], message)
  end
end
