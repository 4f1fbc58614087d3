defmodule BB.Sensor.OpenLoopPositionEstimator do
  import BB.Unit, only: [sigil_u: 2]
  import BB.Unit.Option

  alias BB.Sensor.OpenLoopPositionEstimator.Motion

  @defaults [publish_rate: ~u(50 hertz), max_silence: ~u(5 second), easing: :linear]

  @options BB.Options.new!(
             actuator: [
               type: :atom,
               required: true,
               doc: "The name of the actuator, on the same joint."
             ],
             easing: [
               type: {:in, Motion.easings()},
               default: @defaults[:easing],
               doc: """
               The course of a motion whose acceleration is unknown: `:linear`, or `ease_in_…`, \
               `ease_out_…` or `ease_in_out_…` with `sine`, `quad`, `cubic`, `quartic`, \
               `quintic`, `expo` or `circular`.
               """
             ],
             publish_rate: [
               type: unit_type(compatible: :hertz),
               default: @defaults[:publish_rate],
               doc: "Messages a second during a motion."
             ],
             max_silence: [
               type: unit_type(compatible: :second),
               default: @defaults[:max_silence],
               doc: "The time after which the position is published again without a motion."
             ]
           )

  @moduledoc """
  A sensor that calculates the position of a joint from the motions that its actuator announces.

  Declare it for an actuator that does not measure its position, such as a hobby servo:

      joint :shoulder do
        actuator :servo, {MyRobot.Servo, channel: 0}
        sensor :servo_position, {BB.Sensor.OpenLoopPositionEstimator, actuator: :servo}
      end

  It publishes a `BB.Message.Sensor.JointState` during each motion that the actuator announces by
  a `BB.Message.Actuator.BeginMotion`, and the last position from time to time. The position is
  that of the command, not of the joint: nothing shows that the joint has arrived. Before the
  first motion it publishes nothing.

  ## Options

  #{BB.Options.docs(@options)}
  """

  use BB.Sensor, options_schema: @options.schema

  alias BB.{Message, PubSub, Unit}
  alias BB.Message.Actuator.BeginMotion
  alias BB.Message.Sensor.JointState

  @impl BB.Sensor
  def init(opts) do
    opts = Keyword.merge(@defaults, opts)
    %{robot: robot, path: path} = bb = Keyword.fetch!(opts, :bb)
    actuator = Keyword.fetch!(opts, :actuator)
    actuator_path = [:actuator | Enum.drop(path, -1)] ++ [actuator]
    _ = PubSub.subscribe(robot, actuator_path, message_types: [BeginMotion])

    state = %{
      bb: bb,
      actuator: actuator,
      actuator_path: actuator_path,
      easing: opts[:easing],
      publish_interval_ms: interval_ms(opts[:publish_rate]),
      max_silence_ms: round(Unit.convert!(opts[:max_silence], :second).value * 1_000),
      joint_name: Enum.at(path, -2),
      name: List.last(path),
      initial_position: nil,
      target_position: nil,
      expected_arrival: nil,
      command_time: nil,
      acceleration: nil,
      peak_velocity: nil,
      last_published: nil,
      tick_ref: nil
    }

    {:ok, state, state.max_silence_ms}
  end

  defp interval_ms(rate), do: max(round(1_000 / Unit.convert!(rate, :hertz).value), 1)

  @impl BB.Sensor
  def handle_info({:bb, _path, %Message{} = message}, state), do: handle_info(message, state)

  def handle_info(%Message{payload: %BeginMotion{} = motion}, state) do
    state = state |> cancel_tick() |> put_motion(motion)

    noreply(
      if arrived?(state), do: publish(state, state.target_position), else: tick_later(state)
    )
  end

  def handle_info(:tick, %{target_position: nil} = state), do: noreply(%{state | tick_ref: nil})

  def handle_info(:tick, state) do
    if arrived?(state),
      do: noreply(publish(%{state | tick_ref: nil}, state.target_position)),
      else: state |> publish_change(position(state)) |> tick_later() |> noreply()
  end

  def handle_info(:timeout, %{target_position: nil} = state), do: noreply(state)
  def handle_info(:timeout, state), do: noreply(publish(state, position(state)))
  def handle_info(_message, state), do: noreply(state)

  @impl BB.Sensor
  def handle_call(_request, _from, state),
    do: {:reply, {:error, :not_implemented}, state, state.max_silence_ms}

  @impl BB.Sensor
  def handle_cast(_request, state), do: noreply(state)

  defp noreply(state), do: {:noreply, state, state.max_silence_ms}

  defp put_motion(state, motion) do
    %{
      state
      | initial_position: motion.initial_position,
        target_position: motion.target_position,
        expected_arrival: motion.expected_arrival,
        command_time: now_ms(),
        acceleration: motion.acceleration,
        peak_velocity: motion.peak_velocity
    }
  end

  defp arrived?(state), do: now_ms() >= state.expected_arrival

  defp position(%{acceleration: a, peak_velocity: v} = state) do
    elapsed_ms = now_ms() - state.command_time
    duration_ms = state.expected_arrival - state.command_time
    {start, target} = {state.initial_position, state.target_position}

    cond do
      elapsed_ms >= duration_ms -> target
      a != nil and v != nil -> Motion.trapezoid(elapsed_ms, start, target, duration_ms, a, v)
      true -> Motion.ease(state.easing, elapsed_ms, start, target - start, duration_ms)
    end
  end

  defp publish_change(%{last_published: position} = state, position), do: state
  defp publish_change(state, position), do: publish(state, position)

  defp publish(%{bb: bb} = state, position) do
    fields = [names: [state.joint_name], positions: [position]]
    BB.publish(bb.robot, [:sensor | bb.path], Message.new!(JointState, state.name, fields))
    %{state | last_published: position}
  end

  defp tick_later(state),
    do: %{state | tick_ref: Process.send_after(self(), :tick, state.publish_interval_ms)}

  defp cancel_tick(%{tick_ref: nil} = state), do: state

  # A tick that is in the mailbox already would begin a second series of ticks.
  defp cancel_tick(%{tick_ref: tick_ref} = state) do
    if Process.cancel_timer(tick_ref) == false do
      receive do: (:tick -> :ok), after: (0 -> :ok)
    end

    %{state | tick_ref: nil}
  end

  defp now_ms, do: System.monotonic_time(:millisecond)
end
