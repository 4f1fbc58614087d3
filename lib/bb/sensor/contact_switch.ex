defmodule BB.Sensor.ContactSwitch do
  alias BB.Bus.GPIO.Line
  alias BB.Sensor.Polled

  @schema [
            line: Line.option("The contact's line, such as `{\"gpiochip0\", 17}`."),
            pressed: [
              type: {:in, [:low, :high]},
              default: :low,
              doc:
                "The level when it is pressed: `:low` for a contact to ground that closes, or " <>
                  "one to the supply that opens."
            ],
            pull: [
              type: {:in, [:pullup, :pulldown, :none]},
              default: :pullup,
              doc:
                "The pin's own resistor; `:none` where one is soldered in. A contact to the " <>
                  "supply needs `:pulldown`."
            ],
            debounce: [
              type: BB.Unit.option(:second, 0.001, 1),
              default: 0.005,
              doc: "How long it may bounce: seconds or a unit of time, 1 ms to 1 s."
            ]
          ] ++ Line.options() ++ Polled.options(rate: {0.1, 100}, default: 10)

  @moduledoc """
  A contact on one GPIO line: a bumper, a limit switch or a button.

  Use it for every contact but an emergency stop, which is `BB.Sensor.EmergencyStop`.

      sensor :bumper, {BB.Sensor.ContactSwitch, line: {"gpiochip0", 17}}

  It publishes `BB.Message.Sensor.Contact` when the contact changes, and also at its rate. Each of
  these messages is a new reading of the line, so subscribers know that the sensor works.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Wiring

  Wire the contact between line and ground, with the pin's pull-up. A contact that is normally
  open looks the same with a broken wire as while it is not pressed. A contact that is normally
  closed (`pressed: :high` to ground) is pressed when its wire breaks.

  ## Faults

  While the contact bounces, the sensor waits (`BB.Sensor.ContactSwitch.Debounce`): it publishes
  nothing, and the line's interrupts are off. A line that does not come to rest stops the sensor
  with `:noise`. Three failed readings in a row stop it with a `t:BB.Bus.GPIO.Line.reason/0`.
  """

  use BB.Sensor.Polled, options_schema: @schema

  alias BB.{Clock, Message}
  alias BB.Message.Sensor.Contact
  alias BB.Sensor.ContactSwitch.Debounce

  @impl BB.Sensor
  defdelegate explain(reason), to: Line

  @impl Polled
  def open(opts) do
    open = fn -> Line.open(opts[:gpio], opts[:line], :input, pull_mode: opts[:pull]) end
    Line.open_with(open, &start(&1, opts))
  end

  defp start(line, opts) do
    with :ok <- Line.check_quiet(line), {:ok, level} <- Line.read(line) do
      {:ok,
       %{
         line: line,
         clock: Clock.of(opts[:bb].robot),
         pressed: if(opts[:pressed] == :low, do: 0, else: 1),
         debounce: Debounce.new(round(opts[:debounce] * 1.0e9), level),
         timer: nil
       }}
    end
  end

  @impl Polled
  def close(contact), do: Line.close(contact.line)

  @impl Polled
  def measure(%{debounce: %{waiting?: true}} = contact, _now_ns), do: {:none, contact}

  def measure(contact, now_ns) do
    with {:ok, level} <- Line.read(contact.line) do
      {_changed, debounce} = Debounce.put_level(contact.debounce, now_ns, level)
      {:ok, level, %{contact | debounce: debounce}}
    end
  end

  @impl Polled
  def publish(level, sensor) do
    pressed? = level == sensor.device.pressed
    BB.Sensor.publish(sensor.bb, Message.new!(Contact, sensor.frame_id, pressed: pressed?))
  end

  @impl BB.Sensor
  def handle_info(
        {:circuits_gpio, spec, _time_ns, _level},
        %{device: %{line: %{spec: spec}} = contact} = sensor
      ),
      do: handle_edge(contact, Clock.now_ns(contact.clock), sensor)

  def handle_info({:debounced, timer}, %{device: %{timer: timer}} = sensor),
    do: read_debounced(sensor)

  def handle_info(message, sensor), do: Polled.handle_info(message, sensor)

  defp handle_edge(contact, now_ns, sensor) do
    case Debounce.edge(contact.debounce, now_ns) do
      {:wait, until_ns, debounce} -> wait(%{contact | debounce: debounce}, until_ns, sensor)
      {:same, _debounce} -> {:noreply, sensor}
      :noise -> {:stop, {:shutdown, {:noise, contact.line.spec}}, sensor}
    end
  end

  defp wait(contact, until_ns, sensor) do
    timer = make_ref()
    _ = Clock.send_at(contact.clock, until_ns, self(), {:debounced, timer})
    sensor = %{sensor | device: %{contact | timer: timer}}
    noreply_or_stop(Line.listen(contact.line, :none), sensor)
  end

  # Edges are turned on before the level is read, so that none is missed in between.
  defp read_debounced(%{device: contact} = sensor) do
    with :ok <- Line.listen(contact.line, :both), {:ok, level} <- Line.read(contact.line) do
      {change, debounce} =
        Debounce.put_level(contact.debounce, Clock.now_ns(contact.clock), level)

      sensor = %{sensor | device: %{contact | debounce: debounce, timer: nil}}
      if change == :changed, do: publish(level, sensor)
      {:noreply, sensor}
    else
      error -> noreply_or_stop(error, sensor)
    end
  end

  defp noreply_or_stop(:ok, sensor), do: {:noreply, sensor}
  defp noreply_or_stop({:error, reason}, sensor), do: {:stop, {:shutdown, reason}, sensor}
end
