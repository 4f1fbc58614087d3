defmodule BB.Sensor.HcSr04 do
  alias BB.Bus.GPIO.Line
  alias BB.Sensor.Polled

  @least 0.02

  @schema [
            trigger: Line.option("The line of the pin TRIG, such as `{\"gpiochip0\", 23}`."),
            echo: Line.option("The line of the pin ECHO, which has 5 V and needs a divider."),
            max_range: [
              type: BB.Unit.option(:meter, 0.1, 4),
              default: 4.0,
              doc: "Farther obstacles are `:infinity`: m or a unit of length, 10 cm to 4 m."
            ],
            speed_of_sound: [
              type: BB.Unit.option(:meter_per_second, 300, 400),
              default: 343.2,
              doc: "In m/s or a unit of speed; 343.2 at 20 °C, and 0.6 more for each degree."
            ]
          ] ++ Line.options() ++ Polled.options(rate: {0.1, 16}, default: 10)

  @moduledoc """
  The HC-SR04 on two GPIO lines: distance by ultrasound.

  Use it for obstacles from 2 cm to 4 m.

      sensor :front, {BB.Sensor.HcSr04, trigger: {"gpiochip0", 23}, echo: {"gpiochip0", 24}}

  It publishes `BB.Message.Sensor.Range` when an echo ends: 2 cm to 4 m in a cone of 15°,
  `:infinity` without an obstacle. The width of the echo is the difference between the kernel's
  timestamps of its two edges, so a busy machine does not lengthen it.

  ## Options

  #{BB.Options.docs(@schema)}

  Sensors that receive each other's bursts disturb each other. The datasheet requires 60 ms
  between two bursts, which limits the rate.

  ## Disarming

  `c:BB.Sensor.disarm/1` sets the trigger low, without the sensor's process. The sensor takes its
  line back with the next burst and continues to measure, because a robot that is not armed also
  needs the distance.

  ## Faults

  Each burst must have one echo. Without an echo, with an echo that does not end, or with edges
  that belong to no echo, the reading has failed, and nothing is published. Three failed readings
  in a row stop the sensor, with a `t:reason/0`. The start sends a burst and waits for its echo.
  """

  use BB.Sensor.Polled, options_schema: @schema

  alias BB.{Clock, Message}
  alias BB.Message.Sensor.Range
  alias BB.Sensor.HcSr04.Echo

  @typedoc "Why the sensor does not work: a reason of its lines, or of the echo."
  @type reason ::
          Line.reason()
          | {:no_echo, trigger :: Line.spec(), echo :: Line.spec()}
          | {:echo_stuck, echo :: Line.spec()}

  @field_of_view 15 * :math.pi() / 180
  @pulse_ns 10_000
  @trial_ms 100

  @doc """
  Formats a reason as a sentence that says what to check.

      iex> BB.Sensor.HcSr04.explain({:echo_stuck, {"gpiochip0", 24}})
      "the echo on line 24 of gpiochip0 does not end: check its wire, the divider and the module"
  """
  @impl BB.Sensor
  @spec explain(reason()) :: String.t()
  def explain({:no_echo, trigger, echo}),
    do:
      "no echo on #{Line.name(echo)} after a trigger on #{Line.name(trigger)}: check wiring " <>
        "and power"

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

  # The line stays low when the wire is broken.
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

    with :ok <- Line.check_quiet(echo), do: await_first_echo(sonar, Clock.of(opts[:bb].robot))
  end

  # A stepped clock stands still during the start.
  defp await_first_echo(sonar, :real) do
    with {:ok, sonar} <- burst(sonar) do
      await_echo(sonar, System.monotonic_time(:millisecond) + @trial_ms)
    end
  end

  defp await_first_echo(sonar, _stepped), do: {:ok, sonar}

  defp await_echo(%{burst: :none} = sonar, _until_ms), do: {:ok, sonar}

  defp await_echo(%{echo: %{spec: spec}} = sonar, until_ms) do
    receive do
      {:circuits_gpio, ^spec, time_ns, level} ->
        {_range, sonar} = put_edge(sonar, level, time_ns)
        await_echo(sonar, until_ms)
    after
      max(until_ms - System.monotonic_time(:millisecond), 0) -> {:error, failure(sonar)}
    end
  end

  @impl Polled
  def close(sonar) do
    Line.close(sonar.trigger)
    Line.close(sonar.echo)
  end

  # A good echo was published when it ended. Only failures are left for the tick.
  @impl Polled
  def measure(%{burst: :none} = sonar, _now_ns) do
    case burst(sonar) do
      {:ok, sonar} -> {:none, sonar}
      {:error, reason} -> {:error, reason}
    end
  end

  # The next burst comes after a period of silence.
  def measure(%{burst: :noise} = sonar, _now_ns) do
    _ = Line.listen(sonar.echo, :both)
    {:error, failure(sonar), %{sonar | burst: :none}}
  end

  def measure(sonar, _now_ns) do
    case burst(sonar) do
      {:ok, next} -> {:error, failure(sonar), next}
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
  def handle_info(
        {:circuits_gpio, spec, time_ns, level},
        %{device: %{echo: %{spec: spec}} = sonar} = sensor
      ) do
    {range, sonar} = put_edge(sonar, level, time_ns)
    sensor = %{sensor | device: sonar}
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

  # disarm/1 takes the line over and closes it.
  defp pulse(trigger, opts) do
    with {:error, {:line_lost, _spec}} <- pulse(trigger),
         {:ok, trigger} <- open_trigger(opts),
         do: pulse(trigger)
  end

  defp pulse(trigger) do
    with :ok <- Line.write(trigger, 1),
         :ok <- busy_wait(System.monotonic_time(:nanosecond) + @pulse_ns),
         :ok <- Line.write(trigger, 0),
         do: {:ok, trigger}
  end

  # Shorter than a timer can be.
  defp busy_wait(until_ns),
    do: if(System.monotonic_time(:nanosecond) < until_ns, do: busy_wait(until_ns), else: :ok)

  defp put_edge(%{burst: :sent} = sonar, 1, time_ns),
    do: {nil, %{sonar | burst: {:echo, time_ns}}}

  defp put_edge(%{burst: {:echo, rise_ns}} = sonar, 0, time_ns) do
    case Echo.range(time_ns - rise_ns, sonar.speed, sonar.limits) do
      :too_short -> ignore_edges(sonar)
      range -> {range, %{sonar | burst: :none}}
    end
  end

  defp put_edge(%{burst: :noise} = sonar, _level, _time_ns), do: {nil, sonar}
  defp put_edge(sonar, _level, _time_ns), do: ignore_edges(sonar)

  # If the line is lost here, the next reading finds it out.
  defp ignore_edges(sonar) do
    _ = Line.listen(sonar.echo, :none)
    {nil, %{sonar | burst: :noise}}
  end

  defp failure(%{burst: :sent} = sonar), do: {:no_echo, sonar.trigger.spec, sonar.echo.spec}
  defp failure(%{burst: :noise} = sonar), do: {:noise, sonar.echo.spec}
  defp failure(sonar), do: {:echo_stuck, sonar.echo.spec}
end
