defmodule BB.Sensor.EmergencyStop do
  alias BB.Bus.GPIO.Line
  alias BB.Sensor.Polled

  @schema [
            line: Line.option("The contact's line, such as `{\"gpiochip0\", 27}`."),
            closed: [
              type: {:in, [:low, :high]},
              default: :low,
              doc:
                "The level while the contact is closed: `:low` for a contact to ground, " <>
                  "`:high` for one to the supply. The pin's own resistor pulls the other way."
            ],
            release: [
              type: BB.Unit.option(:second, 0, 10),
              default: 0.1,
              doc:
                "How long the contact has to be closed without a break before arming is " <>
                  "allowed again: seconds or a unit of time."
            ]
          ] ++ Line.options() ++ Polled.options(rate: {10, 200}, default: 50)

  @moduledoc """
  An emergency stop on one GPIO line: pressing it disarms the robot, and while it is pressed the
  robot cannot be armed.

  Use it for the second contact of an emergency stop button.

      sensor :estop, {BB.Sensor.EmergencyStop, line: {"gpiochip0", 27}}

  It publishes `BB.Message.Sensor.Contact` when the contact changes, and also at its rate.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Wiring

  Use a contact that is **normally closed**, between line and ground (or supply, with
  `closed: :high`). A broken wire, an unplugged connector and a pressed button then have the same
  effect: the circuit is open, the pin's resistor pulls the line, and the robot is disarmed. One
  line cannot detect a short circuit beside the button, which looks like a closed contact. Press
  the button before each day's work to test it.

  An emergency stop that people rely on cuts the actuators' power by a circuit, without software.
  This sensor reads its second contact.

  ## What it does

  - **Arming is forbidden from before the robot's start** (`c:BB.Sensor.inhibition/0`) until the
    sensor has read a closed contact.
  - At any edge of the line it first forbids arming (`BB.Safety.inhibit/3`, with the reason
    `:pressed`) and then disarms the robot. It does not debounce: a contact that breaks for a
    moment was open. If an interrupt is lost, the next reading finds the open contact.
  - When the contact was closed for the release time, arming is allowed again. The robot stays
    disarmed until something arms it.
  - It vouches for its release (`BB.Safety.vouch/2`). When its process ends, for whatever reason,
    an armed robot is disarmed, and arming is forbidden (`:unattended`) until the next process has
    read a closed contact. A crash therefore leaves no gap, and neither does a new value of a
    parameter that an option refers to: the robot is disarmed and the line is opened again.

  The `disarm/1` of an actuator takes time. The robot, however, is no longer armed at once, and
  actuators take no commands from then on.

  ## Faults

  A line that cannot be read counts as open: the first reading that fails disarms the robot. With
  the third failure the sensor stops, with a `t:BB.Bus.GPIO.Line.reason/0`. A line that does not
  come to rest stops it with `:noise`.
  """

  use BB.Sensor.Polled, options_schema: @schema

  alias BB.{Message, Safety}
  alias BB.Message.Sensor.Contact
  alias BB.Sensor.EmergencyStop.Halt

  @impl BB.Sensor
  def inhibition, do: :not_started

  @impl BB.Sensor
  defdelegate explain(reason), to: Line

  @impl Polled
  def open(opts) do
    # The process must not wait for what the robot computes.
    Process.flag(:priority, :high)
    bb = opts[:bb]
    :ok = Safety.inhibit(bb.robot, bb.path, :starting)
    # The line is not watched while new options are applied.
    _ = Safety.Controller.disarm(bb.robot)

    with {:error, reason} <- Line.open_with(fn -> open_line(opts) end, &start(&1, opts)) do
      :ok = Safety.inhibit(bb.robot, bb.path, :failed)
      {:error, reason}
    end
  end

  defp open_line(opts) do
    pull = if opts[:closed] == :low, do: :pullup, else: :pulldown
    Line.open(opts[:gpio], opts[:line], :input, pull_mode: pull)
  end

  # check_quiet/1 turns edges on, so none is missed after the reading.
  defp start(line, opts) do
    closed = if opts[:closed] == :low, do: 0, else: 1

    with :ok <- Line.check_quiet(line), {:ok, level} <- Line.read(line) do
      {first, halt} = Halt.new(contact(level, closed), round(opts[:release] * 1.0e9))
      report_first(first, opts[:bb])
      {:ok, %{line: line, bb: opts[:bb], closed: closed, halt: halt}}
    end
  end

  defp report_first(:released, bb), do: Safety.vouch(bb.robot, bb.path)
  defp report_first(:halted, bb), do: Safety.inhibit(bb.robot, bb.path, :pressed)

  @impl Polled
  def close(stop), do: Line.close(stop.line)

  @impl Polled
  def measure(stop, now_ns) do
    with {:ok, level} <- Line.read(stop.line),
         {action, halt} = Halt.reading(stop.halt, contact(level, stop.closed), now_ns),
         :ok <- run_action(action, stop) do
      {:ok, halt.state == :halted, %{stop | halt: halt}}
    else
      {:error, reason} -> {:error, reason, halt_on_failure(stop)}
    end
  end

  defp halt_on_failure(stop) do
    halt_robot(stop.bb, :failed)
    {:halted, halt} = Halt.new(:open, stop.halt.release_ns)
    %{stop | halt: halt}
  end

  @impl Polled
  def publish(pressed?, sensor),
    do: BB.Sensor.publish(sensor.bb, Message.new!(Contact, sensor.frame_id, pressed: pressed?))

  @impl BB.Sensor
  def handle_info(
        {:circuits_gpio, spec, _time_ns, _level},
        %{device: %{line: %{spec: spec}} = stop} = sensor
      ) do
    {action, halt} = Halt.edge(stop.halt)
    _ = run_action(action, stop)
    sensor = %{sensor | device: %{stop | halt: halt}}

    case action do
      :halt -> noreply(publish(true, sensor), sensor)
      :wait -> {:noreply, sensor}
      :noise -> {:stop, {:shutdown, {:noise, spec}}, sensor}
    end
  end

  def handle_info(message, sensor), do: Polled.handle_info(message, sensor)

  defp noreply(:ok, sensor), do: {:noreply, sensor}

  # If the line is lost here, the next reading finds it out.
  defp run_action(:halt, stop) do
    halt_robot(stop.bb, :pressed)
    _ = Line.listen(stop.line, :none)
    :ok
  end

  defp run_action(:wait, stop) do
    _ = Line.listen(stop.line, :none)
    :ok
  end

  defp run_action(:listen, stop), do: Line.listen(stop.line, :both)
  defp run_action(:release, stop), do: Safety.vouch(stop.bb.robot, stop.bb.path)
  defp run_action(action, _stop) when action in [:none, :noise], do: :ok

  # Disarming waits for the actuators, so it runs in a process of its own, not linked, which
  # continues when the sensor ends. It runs in every state of the robot, which may be about to
  # change.
  defp halt_robot(%{robot: robot, path: path}, reason) do
    :ok = Safety.inhibit(robot, path, reason)
    _ = :erlang.spawn_opt(fn -> Safety.Controller.disarm(robot) end, priority: :high)
    :ok
  end

  defp contact(level, closed), do: if(level == closed, do: :closed, else: :open)
end
