defmodule BB.Sensor.ContactSwitch do
  alias BB.Bus.GPIO.Line
  alias BB.Sensor.Polled

  @schema [
            line: Line.option("The contact's line, such as `{\"gpiochip0\", 17}`."),
            pressed: [
              type: {:in, [:low, :high]},
              default: :low,
              doc:
                "The level when it is pressed: `:low` for a contact to ground that closes, or one to the supply that opens."
            ],
            pull: [
              type: {:in, [:pullup, :pulldown, :none]},
              default: :pullup,
              doc:
                "The pin's own resistor; `:none` where one is soldered in. A contact to the supply needs `:pulldown`."
            ],
            debounce: [
              type: BB.Unit.option(:second, 0.001, 1),
              default: 0.005,
              doc: "How long it may bounce: seconds or a unit of time, 1 ms to 1 s."
            ]
          ] ++ Line.options() ++ Polled.options(rate: {0.1, 100}, default: 10)

  @moduledoc """
  A contact that something presses: a bumper, a limit switch, a button. On one GPIO line.

      sensor :bumper, {BB.Sensor.ContactSwitch, line: {"gpiochip0", 17}}

  Publishes `BB.Message.Sensor.Contact` when it changes, and besides at its rate: the line is read anew each time, so that whoever listens
  knows that somebody watches. An emergency stop is `BB.Sensor.EmergencyStop`.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Wiring
  Between line and ground, with the pin's pull-up. A contact that is open when nobody presses it cannot tell a broken wire from that;
  one that is closed (`pressed: :high` to ground) is pressed when its wire breaks.

  ## What goes wrong
  What bounces is waited for (`BB.Sensor.ContactSwitch.Debounce`); meanwhile nothing is published, and the line's interrupts are off. A line
  that does not come to rest stops the sensor with `:noise`, and so do three readings in a row that fail, with a `t:BB.Bus.GPIO.Line.reason/0`.
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
    Line.open_with(open, &watch(&1, opts))
  end

  defp watch(line, opts) do
    with :ok <- Line.check_quiet(line), {:ok, level} <- Line.read(line) do
      {:ok,
       %{
         line: line,
         clock: Clock.of(opts[:bb].robot),
         pressed: if(opts[:pressed] == :low, do: 0, else: 1),
         debounce: Debounce.new(round(opts[:debounce] * 1.0e9), level),
         rest: nil
       }}
    end
  end

  @impl Polled
  def close(contact), do: Line.close(contact.line)

  @impl Polled
  def measure(%{debounce: %{waiting?: true}} = contact, _now_ns), do: {:none, contact}

  def measure(contact, now_ns) do
    with {:ok, level} <- Line.read(contact.line) do
      {_changed, debounce} = Debounce.rest(contact.debounce, now_ns, level)
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
        %{device: %{line: %{spec: spec}}} = s
      ),
      do: edge(s.device, Clock.now_ns(s.device.clock), s)

  def handle_info({:rest, rest}, %{device: %{rest: rest}} = sensor), do: look(sensor)
  def handle_info(message, sensor), do: Polled.handle_info(message, sensor)

  defp edge(contact, now_ns, sensor) do
    case Debounce.edge(contact.debounce, now_ns) do
      {:wait, until_ns, debounce} -> wait(%{contact | debounce: debounce}, until_ns, sensor)
      {:same, _debounce} -> {:noreply, sensor}
      :restless -> {:stop, {:shutdown, {:noise, contact.line.spec}}, sensor}
    end
  end

  defp wait(contact, until_ns, sensor) do
    rest = make_ref()
    _ = Clock.send_at(contact.clock, until_ns, self(), {:rest, rest})
    sensor = %{sensor | device: %{contact | rest: rest}}
    Line.listen(contact.line, :none) |> go_on(sensor)
  end

  # Edges are told again before the level is read, so that none is missed in between.
  defp look(%{device: contact} = sensor) do
    with :ok <- Line.listen(contact.line, :both), {:ok, level} <- Line.read(contact.line) do
      {change, debounce} = Debounce.rest(contact.debounce, Clock.now_ns(contact.clock), level)
      sensor = %{sensor | device: %{contact | debounce: debounce, rest: nil}}
      if change == :changed, do: publish(level, sensor)
      {:noreply, sensor}
    else
      error -> go_on(error, sensor)
    end
  end

  defp go_on(:ok, sensor), do: {:noreply, sensor}
  defp go_on({:error, reason}, sensor), do: {:stop, {:shutdown, reason}, sensor}
end
