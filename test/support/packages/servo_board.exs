# Servos on a board with channels: a controller for the board, an actuator for each servo that
# calls the controller by name.
defmodule ServoBoard.ChannelTaken do
  @moduledoc false

  use BB.Error, class: :hardware, fields: [:channel]

  defimpl BB.Error.Severity do
    def severity(_error), do: :critical
  end

  def message(%{channel: channel}), do: "channel #{channel} has a servo already"
end

defmodule ServoBoard.Controller do
  @moduledoc false

  use BB.Controller

  alias BB.Message.Sensor.JointState
  alias ServoBoard.ChannelTaken

  @impl BB.Controller
  def options_schema do
    Spark.Options.new!(
      bus: [type: :string, required: true],
      address: [type: :integer, default: 0x40]
    )
  end

  @impl BB.Controller
  def init(opts), do: {:ok, %{bb: opts[:bb], channels: %{}}}

  @impl BB.Controller
  def handle_call({:attach, channel, joint, servo}, _from, state) do
    case state.channels do
      %{^channel => %{joint: other}} when other != joint ->
        {:reply, {:error, %ChannelTaken{channel: channel}}, state}

      channels ->
        entry = %{joint: joint, servo: servo, pulse_us: nil}
        {:reply, :ok, %{state | channels: Map.put(channels, channel, entry)}}
    end
  end

  def handle_call({:set_pulse, channel, pulse_us, position}, _from, state) do
    state = put_in(state.channels[channel].pulse_us, pulse_us)
    publish(state, state.channels[channel], position)
    {:reply, :ok, state}
  end

  def handle_call({:off, channel}, _from, state),
    do: {:reply, :ok, put_in(state.channels[channel].pulse_us, nil)}

  def handle_call({:pulse, channel}, _from, state),
    do: {:reply, {:ok, state.channels[channel].pulse_us}, state}

  defp publish(state, entry, position) do
    message =
      BB.Message.new!(JointState, entry.joint, names: [entry.joint], positions: [position])

    BB.publish(state.bb.robot, [:sensor | state.bb.path], message)
  end
end

defmodule ServoBoard.Actuator do
  @moduledoc false

  use BB.Actuator

  alias BB.Error.Invalid.JointConfig
  alias BB.Message
  alias BB.Message.Actuator.Command.Position

  @impl BB.Actuator
  def options_schema do
    Spark.Options.new!(
      controller: [type: :atom, required: true],
      channel: [type: {:in, 0..15}, required: true],
      min_pulse_us: [type: :pos_integer, default: 500],
      max_pulse_us: [type: :pos_integer, default: 2500]
    )
  end

  @impl BB.Actuator
  def init(opts) do
    bb = Keyword.fetch!(opts, :bb)
    [servo, joint | _] = Enum.reverse(bb.path)
    profile = Keyword.fetch!(opts, :motor_profile)

    with :ok <- check(joint, profile),
         :ok <-
           BB.Process.call(bb.robot, opts[:controller], {:attach, opts[:channel], joint, servo}) do
      BB.Safety.register(__MODULE__,
        robot: bb.robot,
        path: bb.path,
        opts: [bb: bb, controller: opts[:controller], channel: opts[:channel]]
      )

      start = profile.motor_initial_position
      {:ok, %{bb: bb, opts: Map.new(opts), profile: profile, position: start}}
    else
      {:error, reason} -> {:stop, reason}
    end
  end

  @impl BB.Actuator
  def disarm(opts) do
    BB.Process.call(opts[:bb].robot, opts[:controller], {:off, opts[:channel]})
  end

  @impl BB.Actuator
  def command_payloads(_opts), do: [Position]

  @impl BB.Actuator
  def handle_options(opts, state),
    do: {:ok, %{state | opts: Map.new(opts), profile: opts[:motor_profile]}}

  @impl BB.Actuator
  def handle_command(%Message{payload: %Position{} = command}, state) do
    %{bb: bb, opts: opts, profile: profile} = state
    target = command.position |> max(profile.motor_lower) |> min(profile.motor_upper)
    request = {:set_pulse, opts.channel, pulse_us(target, profile, opts), target}

    case BB.Process.call(bb.robot, opts.controller, request) do
      :ok ->
        travel_ms = round(abs(target - state.position) / profile.motor_velocity_limit * 1000)

        BB.Actuator.publish_begin_motion(bb.robot, bb.path,
          initial_position: state.position,
          target_position: target,
          expected_arrival: System.monotonic_time(:millisecond) + travel_ms,
          command_id: command.command_id,
          command_type: :position
        )

        {:reply, {:ok, :accepted}, %{state | position: target}}

      {:error, reason} ->
        {:reply, {:error, reason}, state}
    end
  end

  defp pulse_us(position, %{motor_lower: lower, motor_upper: upper}, opts) do
    share = (position - lower) / (upper - lower)
    round(opts.min_pulse_us + share * (opts.max_pulse_us - opts.min_pulse_us))
  end

  defp check(joint, %{motor_lower: nil}),
    do: {:error, %JointConfig{joint: joint, field: :lower, expected: "a limit"}}

  defp check(joint, %{motor_upper: nil}),
    do: {:error, %JointConfig{joint: joint, field: :upper, expected: "a limit"}}

  defp check(joint, %{motor_velocity_limit: nil}),
    do: {:error, %JointConfig{joint: joint, field: :velocity, expected: "a limit"}}

  defp check(_joint, _profile), do: :ok
end
