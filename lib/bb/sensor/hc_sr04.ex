defmodule BB.Sensor.HcSr04 do
  alias BB.Bus.GPIO.Line
  alias BB.Sensor.Polled

  @least 0.02

  @schema [
            trigger: Line.option("The line of the pin TRIG, such as `{\"gpiochip0\", 23}`."),
            echo: Line.option("The line of the pin ECHO; 5 V, so by a divider."),
            max_range: [
              type: BB.Unit.option(:meter, 0.1, 4),
              default: 4.0,
              doc: "What is farther is `:infinity`: m or a unit of length, 10 cm to 4 m."
            ],
            speed_of_sound: [
              type: BB.Unit.option(:meter_per_second, 300, 400),
              default: 343.2,
              doc: "In m/s or a unit of speed; 343.2 at 20 °C, and 0.6 more for each degree."
            ]
          ] ++ Line.options() ++ Polled.options(rate: {0.1, 16}, default: 10)

  @moduledoc """
  The HC-SR04: distance by ultrasound. On two GPIO lines.

      sensor :front, {BB.Sensor.HcSr04, trigger: {"gpiochip0", 23}, echo: {"gpiochip0", 24}}

  Publishes `BB.Message.Sensor.Range` when the echo has ended: 2 cm to 4 m in a cone of 15°, `:infinity` when nothing is in reach.
  The width of the echo is that between the kernel's time stamps of its two edges, so that a busy machine does not stretch it.

  ## Options

  #{BB.Options.docs(@schema)}

  Sensors that hear each other's bursts disturb each other; the datasheet asks for 60 ms between two bursts, hence the limit of the rate.

  ## Disarming
  `c:BB.Sensor.disarm/1` sets the trigger low, whatever its process does, so that nothing holds it up. The sensor takes its line back with the next
  burst and goes on measuring: a robot that is not armed still wants to know what is near it.

  ## What goes wrong
  Each burst has one echo, or the reading has failed: no echo at all, one that does not end, edges that belong to none. Nothing is published then. Three failed readings
  in a row stop the sensor, with a `t:reason/0`. Starting sends a burst and waits for its echo.
  """

  use BB.Sensor.Polled, options_schema: @schema

  alias BB.{Clock, Message}
  alias BB.Message.Sensor.Range
  alias BB.Sensor.HcSr04.Echo

  @typedoc "Why it does not work, besides what the lines say."
  @type reason ::
          Line.reason()
          | {:no_echo, trigger :: Line.spec(), echo :: Line.spec()}
          | {:echo_stuck, echo :: Line.spec()}

  @field_of_view 15 * :math.pi() / 180
  @pulse_ns 10_000
  @trial_ms 100

  @doc """
  A reason in a sentence that says what to look at.

      iex> BB.Sensor.HcSr04.explain({:no_echo, {"gpiochip0", 23}, {"gpiochip0", 24}})
      "no echo on line 24 of gpiochip0 after a trigger on line 23 of gpiochip0: check wiring and power"
  """
  @impl BB.Sensor
  @spec explain(reason()) :: String.t()
  def explain({:no_echo, trigger, echo}),
    do:
      "no echo on #{Line.name(echo)} after a trigger on #{Line.name(trigger)}: check wiring and power"

  def explain({:echo_stuck, echo}),
    do: "the echo on #{Line.name(echo)} does not end: check its wire, the divider and the module"

  def explain(reason), do: Line.explain(reason)

  @impl BB.Sensor
  def disarm(opts) do
    with {:ok, trigger} <- open_trigger(opts), do: Line.close(trigger)
  end

  @impl Polled
  def open(opts) do
    Line.open_with(fn -> open_trigger(opts) end, fn trigger ->
      Line.open_with(fn -> open_echo(opts) end, &start(trigger, &1, opts))
    end)
  end

  defp open_trigger(opts),
    do: Line.open(opts[:gpio], opts[:trigger], :output, initial_value: 0)

  # A wire that is broken is silent.
  defp open_echo(opts), do: Line.open(opts[:gpio], opts[:echo], :input, pull_mode: :pulldown)

  defp start(trigger, echo, opts) do
    sonar = %{
      trigger: trigger,
      echo: echo,
      opts: opts,
      speed: opts[:speed_of_sound] * 1.0,
      limits: {@least, opts[:max_range] * 1.0},
      burst: :none
    }

    with :ok <- Line.check_quiet(echo), do: try_out(sonar, Clock.of(opts[:bb].robot))
  end

  # Time that is stepped does not pass while it is waited for.
  defp try_out(sonar, :real) do
    with {:ok, sonar} <- burst(sonar) do
      await(sonar, System.monotonic_time(:millisecond) + @trial_ms)
    end
  end

  defp try_out(sonar, _stepped), do: {:ok, sonar}

  defp await(%{burst: :none} = sonar, _until_ms), do: {:ok, sonar}

  defp await(%{echo: %{spec: spec}} = sonar, until_ms) do
    receive do
      {:circuits_gpio, ^spec, time_ns, level} ->
        {_range, sonar} = edge(sonar, level, time_ns)
        await(sonar, until_ms)
    after
      max(until_ms - System.monotonic_time(:millisecond), 0) -> {:error, missed(sonar)}
    end
  end

  @impl Polled
  def close(sonar) do
    Line.close(sonar.trigger)
    Line.close(sonar.echo)
  end

  # The echo of the last burst was published when it ended. What is left is what went wrong with it.
  @impl Polled
  def measure(%{burst: :none} = sonar, _now_ns) do
    case burst(sonar) do
      {:ok, sonar} -> {:none, sonar}
      {:error, reason} -> {:error, reason}
    end
  end

  # No burst before there was silence for a period.
  def measure(%{burst: :noise} = sonar, _now_ns) do
    _ = Line.listen(sonar.echo, :both)
    {:error, missed(sonar), %{sonar | burst: :none}}
  end

  def measure(sonar, _now_ns) do
    case burst(sonar) do
      {:ok, next} -> {:error, missed(sonar), next}
      {:error, reason} -> {:error, reason, %{sonar | burst: :none}}
    end
  end

  @impl Polled
  def publish({range, time_ns}, %{device: %{limits: {least, most}}} = sensor) do
    payload = [
      radiation_type: :ultrasound,
      field_of_view: @field_of_view,
      min_range: least,
      max_range: most,
      range: range
    ]

    message = Message.new!(Range, sensor.frame_id, payload, monotonic_time: time_ns)
    BB.Sensor.publish(sensor.bb, message)
  end

  @impl BB.Sensor
  def handle_info({:circuits_gpio, spec, time_ns, level}, %{device: %{echo: %{spec: spec}}} = s) do
    {range, sonar} = edge(s.device, level, time_ns)
    sensor = %{s | device: sonar}
    if range, do: publish({range, time_ns}, sensor)
    {:noreply, sensor}
  end

  def handle_info(message, sensor), do: Polled.handle_info(message, sensor)

  # A burst is `:sent` until its echo rises, then `{:echo, rise_ns}` until that falls.

  defp burst(sonar) do
    with {:ok, 0} <- Line.read(sonar.echo),
         :ok <- Line.listen(sonar.echo, :both),
         {:ok, trigger} <- pulse(sonar.trigger, sonar.opts) do
      {:ok, %{sonar | trigger: trigger, burst: :sent}}
    else
      {:ok, 1} -> {:error, {:echo_stuck, sonar.echo.spec}}
      error -> error
    end
  end

  # A disarming takes the line and gives it back.
  defp pulse(trigger, opts) do
    with {:error, {:line_lost, _spec}} <- pulse(trigger),
         {:ok, trigger} <- open_trigger(opts),
         do: pulse(trigger)
  end

  defp pulse(trigger) do
    with :ok <- Line.write(trigger, 1),
         :ok <- hold(System.monotonic_time(:nanosecond) + @pulse_ns),
         :ok <- Line.write(trigger, 0),
         do: {:ok, trigger}
  end

  # Shorter than anything a timer does.
  defp hold(until_ns),
    do: if(System.monotonic_time(:nanosecond) < until_ns, do: hold(until_ns), else: :ok)

  defp edge(%{burst: :sent} = sonar, 1, time_ns), do: {nil, %{sonar | burst: {:echo, time_ns}}}

  defp edge(%{burst: {:echo, rise_ns}} = sonar, 0, time_ns) do
    case Echo.range(time_ns - rise_ns, sonar.speed, sonar.limits) do
      :too_short -> noise(sonar)
      range -> {range, %{sonar | burst: :none}}
    end
  end

  defp edge(%{burst: :noise} = sonar, _level, _time_ns), do: {nil, sonar}
  defp edge(sonar, _level, _time_ns), do: noise(sonar)

  # A line that is lost is found out by the next reading.
  defp noise(sonar) do
    _ = Line.listen(sonar.echo, :none)
    {nil, %{sonar | burst: :noise}}
  end

  defp missed(%{burst: :sent} = sonar), do: {:no_echo, sonar.trigger.spec, sonar.echo.spec}
  defp missed(%{burst: :noise} = sonar), do: {:noise, sonar.echo.spec}
  defp missed(sonar), do: {:echo_stuck, sonar.echo.spec}
end
