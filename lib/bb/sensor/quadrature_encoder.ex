defmodule BB.Sensor.QuadratureEncoder do
  alias BB.Bus.GPIO.Line
  alias BB.Sensor.Polled

  @schema [
            a: Line.option("The line of channel A, such as `{\"gpiochip0\", 5}`."),
            b: Line.option("The line of channel B, on the same chip."),
            pulses: [
              type: :pos_integer,
              required: true,
              doc:
                "Pulses of one channel in a turn of the encoder's shaft, as its datasheet says; four counts each."
            ],
            pull: [
              type: {:in, [:pullup, :pulldown, :none]},
              default: :pullup,
              doc: "The pins' own resistors; `:none` for an encoder that drives its lines."
            ]
          ] ++
            Line.options() ++
            Keyword.take(Polled.options(rate: {1, 200}, default: 50), [:rate])

  @moduledoc """
  A quadrature encoder: the angle of a wheel or a motor's shaft, and how fast it turns. On two GPIO lines.

      joint :left_wheel do
        type :continuous
        sensor :encoder, {BB.Sensor.QuadratureEncoder, a: {"gpiochip0", 5}, b: {"gpiochip0", 6}, pulses: 11} do
          transmission do reduction 34.0 end
        end
      end

  Publishes `BB.Message.Sensor.JointState` with position (rad, 0 where the shaft was when the sensor started) and velocity (rad/s),
  both in the space of its joint: gears and a wheel that turns the other way belong into the transmission.

  ## Options

  #{BB.Options.docs(@schema)}

  ## How fast
  Each edge is an interrupt and a message with the kernel's time stamp: count on ten thousand a second, which leave half a processor of
  a small board to others. A faster shaft needs a counter in hardware. Velocity is that between edges
  (`BB.Sensor.QuadratureEncoder.Counter`), exact also where a period of the rate has only one or two of them.

  ## What goes wrong
  The position is relative: what is lost while the sensor is down is lost, and it starts at 0 again. `:one_line` stops the sensor when a hundred edges in a row
  come from one line, because the other's wire is broken or this one has noise; `:missed_edges` when more than one in ten is lost in
  a period. Neither can be told from a wheel at rest while there are no edges. Three readings in a row that fail stop it with a `t:BB.Bus.GPIO.Line.reason/0`.
  """

  use BB.Sensor.Polled, options_schema: @schema

  alias BB.Sensor.QuadratureEncoder.Counter

  @typedoc "Why it does not work, besides what the lines say."
  @type reason ::
          Line.reason()
          | {:one_line, heard :: Line.spec(), silent :: Line.spec()}
          | {:missed_edges, [Line.spec()]}

  # Long enough to see noise before it is up.
  @trial_ms 20

  @doc """
  A reason in a sentence that says what to look at.

      iex> BB.Sensor.QuadratureEncoder.explain({:one_line, {"gpiochip0", 5}, {"gpiochip0", 6}})
      "all edges come from line 5 of gpiochip0: check the wire of line 6 of gpiochip0, and for noise"
  """
  @impl BB.Sensor
  @spec explain(reason()) :: String.t()
  def explain({:one_line, heard, silent}),
    do:
      "all edges come from #{Line.name(heard)}: check the wire of #{Line.name(silent)}, and for noise"

  def explain({:missed_edges, lines}),
    do: "edges of #{Line.name(lines)} are lost: it turns too fast, or there is noise"

  def explain(reason), do: Line.explain(reason)

  @impl Polled
  def open(opts) do
    lines = [opts[:a], opts[:b]]
    open = fn -> Line.open(opts[:gpio], lines, :input, pull_mode: opts[:pull]) end
    Line.open_with(open, &watch(&1, opts))
  end

  defp watch(line, opts) do
    encoder = %{
      line: line,
      bb: opts[:bb],
      ref: make_ref(),
      radian: 2 * :math.pi() / (4 * opts[:pulses]),
      counter: Counter.new(),
      looked_ns: nil
    }

    with :ok <- Line.subscribe(line, encoder.ref),
         :ok <- Process.sleep(@trial_ms),
         {:ok, _value} <- Line.read(line),
         do: encoder |> catch_up() |> checked()
  end

  @impl Polled
  def close(encoder), do: Line.close(encoder.line)

  # Without edges only a reading tells that the lines are there.
  @impl Polled
  def measure(encoder, now_ns) do
    with {:ok, _value} <- Line.read(encoder.line), {:ok, encoder} <- checked(encoder) do
      {rate, counter} = Counter.rate(encoder.counter, elapsed_s(encoder, now_ns))
      reading = %{position: counter.count * encoder.radian, velocity: rate * encoder.radian}
      {:ok, reading, %{encoder | counter: counter, looked_ns: now_ns}}
    end
  end

  defp elapsed_s(%{looked_ns: nil}, _now_ns), do: 0.0
  defp elapsed_s(%{looked_ns: looked_ns}, now_ns), do: (now_ns - looked_ns) / 1.0e9

  @impl Polled
  def publish(reading, %{bb: bb}) do
    BB.Sensor.publish_joint_state(bb.robot, bb.path,
      positions: [reading.position],
      velocities: [reading.velocity]
    )
  end

  @impl BB.Sensor
  def handle_info({:circuits_gpio, %{ref: ref} = edge}, %{device: %{ref: ref}} = sensor) do
    case sensor.device |> count(edge) |> checked() do
      {:ok, encoder} -> {:noreply, %{sensor | device: encoder}}
      {:error, reason} -> {:stop, {:shutdown, reason}, sensor}
    end
  end

  def handle_info(message, sensor), do: Polled.handle_info(message, sensor)

  defp count(encoder, edge) do
    counter = Counter.edge(encoder.counter, edge.value, edge.previous_value, edge.timestamp)
    %{encoder | counter: counter}
  end

  defp catch_up(%{ref: ref} = encoder) do
    receive do
      {:circuits_gpio, %{ref: ^ref} = edge} -> encoder |> count(edge) |> catch_up()
    after
      0 -> encoder
    end
  end

  defp checked(%{line: %{spec: [a, b] = lines}} = encoder) do
    case Counter.fault(encoder.counter) do
      nil -> {:ok, encoder}
      {:one_line, :a} -> {:error, {:one_line, a, b}}
      {:one_line, :b} -> {:error, {:one_line, b, a}}
      :missed -> {:error, {:missed_edges, lines}}
    end
  end
end
