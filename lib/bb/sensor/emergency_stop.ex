defmodule BB.Sensor.EmergencyStop do
  alias BB.Bus.GPIO.Line
  alias BB.Sensor.Polled

  @schema [
            line: Line.option("The contact's line, such as `{\"gpiochip0\", 27}`."),
            closed: [
              type: {:in, [:low, :high]},
              default: :low,
              doc:
                "The level while the contact is closed: `:low` for one to ground, `:high` for one to the supply. The pin's own resistor pulls the other way."
            ],
            release: [
              type: BB.Unit.option(:second, 0, 10),
              default: 0.1,
              doc:
                "How long the contact has to be closed without a break before arming is allowed again: seconds or a unit of time."
            ]
          ] ++ Line.options() ++ Polled.options(rate: {10, 200}, default: 50)

  @moduledoc """
  An emergency stop: while it is pressed the robot cannot be armed, and pressing it disarms the robot. On one GPIO line.

      sensor :estop, {BB.Sensor.EmergencyStop, line: {"gpiochip0", 27}}

  Publishes `BB.Message.Sensor.Contact` when it changes, and besides at its rate.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Wiring
  A contact that is **normally closed**, between line and ground (or supply, with `closed: :high`). So a wire that breaks, a plug that
  is out and a button that is pressed are the same: the circuit is open, the pin's resistor pulls the line, the robot is disarmed. What one
  line cannot see is a short circuit beside the button, which looks like a closed contact: test it, by pressing it, before each day's work.

  An emergency stop that people rely on cuts the actuators' power by a circuit, without any software. This is its second contact.

  ## What it does
  - **From before the robot's start on arming is forbidden** (`c:BB.Sensor.inhibition/0`), until it has seen a closed contact.
  - At any edge of the line it forbids arming first (`BB.Safety.inhibit/3`, with the reason `:pressed`) and then disarms the robot. It does not wait for debouncing: a
    contact that breaks for a moment is a contact that was open. Should an interrupt be lost, it sees the open contact at its next reading.
  - When the contact was closed for the release time, arming is allowed again. The robot stays disarmed: to arm it is somebody's decision.
  - It vouches for what it allows (`BB.Safety.vouch/2`): when its process ends, for whatever reason, an armed robot is disarmed and
    arming is forbidden (`:unattended`) until its successor has seen a closed contact. So a crash opens no window. Nor does a new value of a parameter
    that an option follows: the robot is disarmed, and the line opened anew.

  `disarm/1` of an actuator takes its time; what is immediate is that the robot is not armed any more, from which on actuators take
  no commands.

  ## What goes wrong
  A line that cannot be read is as good as open: the robot is disarmed at the first reading that fails. The sensor stops with the third, with a
  `t:BB.Bus.GPIO.Line.reason/0`, or with `:noise` when the line does not come to rest.
  """

  use BB.Sensor.Polled, options_schema: @schema

  alias BB.{Message, Safety}
  alias BB.Message.Sensor.Contact
  alias BB.Sensor.EmergencyStop.Decision

  @impl BB.Sensor
  def inhibition, do: :not_started

  @impl BB.Sensor
  defdelegate explain(reason), to: Line

  @impl Polled
  def open(opts) do
    # A stop does not queue behind what the robot computes.
    Process.flag(:priority, :high)
    bb = opts[:bb]
    :ok = Safety.inhibit(bb.robot, bb.path, :starting)
    # While new options are taken on, nobody watches.
    _ = Safety.disarm(bb.robot)

    with {:error, reason} <- Line.open_with(fn -> open_line(opts) end, &watch(&1, opts)) do
      :ok = Safety.inhibit(bb.robot, bb.path, :failed)
      {:error, reason}
    end
  end

  defp open_line(opts) do
    pull = if opts[:closed] == :low, do: :pullup, else: :pulldown
    Line.open(opts[:gpio], opts[:line], :input, pull_mode: pull)
  end

  # From the check on edges are told, so that none is missed after the reading.
  defp watch(line, opts) do
    closed = if opts[:closed] == :low, do: 0, else: 1

    with :ok <- Line.check_quiet(line), {:ok, level} <- Line.read(line) do
      {first, decision} = Decision.new(contact(level, closed), round(opts[:release] * 1.0e9))
      begin(first, opts[:bb])
      {:ok, %{line: line, bb: opts[:bb], closed: closed, decision: decision}}
    end
  end

  defp begin(:released, bb), do: Safety.vouch(bb.robot, bb.path)
  defp begin(:halted, bb), do: Safety.inhibit(bb.robot, bb.path, :pressed)

  @impl Polled
  def close(stop), do: Line.close(stop.line)

  @impl Polled
  def measure(stop, now_ns) do
    case Line.read(stop.line) do
      {:ok, level} -> stop |> see(contact(level, stop.closed), now_ns) |> measured(stop)
      {:error, reason} -> {:error, reason, failed(stop)}
    end
  end

  defp see(stop, contact, now_ns) do
    {what, decision} = Decision.see(stop.decision, contact, now_ns)
    {act(what, stop), %{stop | decision: decision}}
  end

  defp measured({:ok, stop}, _before), do: {:ok, stop.decision.state == :halted, stop}
  defp measured({{:error, reason}, _stop}, before), do: {:error, reason, failed(before)}

  defp failed(stop) do
    halt(stop.bb, :failed)
    {:halted, decision} = Decision.new(:open, stop.decision.release_ns)
    %{stop | decision: decision}
  end

  @impl Polled
  def publish(pressed?, sensor),
    do: BB.Sensor.publish(sensor.bb, Message.new!(Contact, sensor.frame_id, pressed: pressed?))

  @impl BB.Sensor
  def handle_info({:circuits_gpio, spec, _time_ns, _level}, %{device: %{line: %{spec: spec}}} = s) do
    {what, decision} = Decision.edge(s.device.decision)
    _ = act(what, s.device)
    s = %{s | device: %{s.device | decision: decision}}

    case what do
      :halt -> noreply(publish(true, s), s)
      :wait -> {:noreply, s}
      :restless -> {:stop, {:shutdown, {:noise, spec}}, s}
    end
  end

  def handle_info(message, sensor), do: Polled.handle_info(message, sensor)

  defp noreply(:ok, sensor), do: {:noreply, sensor}

  # A line that was lost meanwhile is found out by the next reading.
  defp act(:halt, stop) do
    halt(stop.bb, :pressed)
    _ = Line.listen(stop.line, :none)
    :ok
  end

  defp act(:wait, stop) do
    _ = Line.listen(stop.line, :none)
    :ok
  end

  defp act(:listen, stop), do: Line.listen(stop.line, :both)
  defp act(:release, stop), do: Safety.vouch(stop.bb.robot, stop.bb.path)
  defp act(what, _stop) when what in [:stay, :restless], do: :ok

  # Disarming waits for the actuators, so it has a process of its own. Not one that is linked: it goes on when the sensor ends.
  # It is asked for whatever the state, which may be about to change.
  defp halt(%{robot: robot, path: path}, reason) do
    :ok = Safety.inhibit(robot, path, reason)
    _ = :erlang.spawn_opt(fn -> Safety.disarm(robot) end, priority: :high)
    :ok
  end

  defp contact(level, closed), do: if(level == closed, do: :closed, else: :open)
end
