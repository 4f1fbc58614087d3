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
                "Pulses of one channel in a turn of the encoder's shaft, from its datasheet. " <>
                  "Each has four counts."
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
  A quadrature encoder on two GPIO lines: the angle and the velocity of a wheel or a motor's
  shaft.

  Use it as a sensor of a joint.

      joint :left_wheel do
        type :continuous

        sensor :encoder,
               {BB.Sensor.QuadratureEncoder,
                a: {"gpiochip0", 5}, b: {"gpiochip0", 6}, pulses: 11} do
          transmission do
            reduction 34.0
          end
        end
      end

  It publishes `BB.Message.Sensor.JointState` with position (rad, 0 at the start of the sensor)
  and velocity (rad/s), both in the space of its joint. Declare gears and a wheel that turns the
  other way in the transmission.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Velocity

  Each edge is an interrupt and a message with the kernel's timestamp. Ten thousand edges a second
  use half a processor of a small board. A faster shaft needs a counter in hardware. The velocity
  is measured between edges (`BB.Sensor.QuadratureEncoder.Counter`), so it is exact also with one
  or two edges in a period of the rate.

  ## Faults

  The position is relative. Edges that come while the sensor is down are lost, and the position
  starts at 0 again. `:one_line` stops the sensor when a hundred edges in a row come from one
  line, because the wire of the other line is broken or this line has noise. `:missed_edges` stops
  it when more than one edge in ten is lost in a period. Without edges, neither differs from a
  wheel at rest. Three failed readings in a row stop it with a `t:BB.Bus.GPIO.Line.reason/0`.
  """

  use BB.Sensor.Polled, options_schema: @schema

  alias BB.Sensor.QuadratureEncoder.Counter

  @typedoc "Why the sensor does not work: a reason of its lines, or of their edges."
  @type reason ::
          Line.reason()
          | {:one_line, active :: Line.spec(), silent :: Line.spec()}
          | {:missed_edges, [Line.spec()]}

  # Long enough to find noise before the sensor is up.
  @trial_ms 20

  @doc """
  Formats a reason as a sentence that says what to check.

      iex> BB.Sensor.QuadratureEncoder.explain({:one_line, "ENC_A", "ENC_B"})
      "all edges come from line ENC_A: check the wire of line ENC_B, and for noise"
  """
  @impl BB.Sensor
  @spec explain(reason()) :: String.t()
  def explain({:one_line, active, silent}),
    do:
      "all edges come from #{Line.name(active)}: check the wire of #{Line.name(silent)}, and " <>
        "for noise"

  def explain({:missed_edges, lines}),
    do: "edges of #{Line.name(lines)} are lost: reduce the speed, and check for noise"

  def explain(reason), do: Line.explain(reason)

  @impl Polled
  def open(opts) do
    lines = [opts[:a], opts[:b]]
    open = fn -> Line.open(opts[:gpio], lines, :input, pull_mode: opts[:pull]) end
    Line.open_with(open, &start(&1, opts))
  end

  defp start(line, opts) do
    encoder = %{
      line: line,
      bb: opts[:bb],
      ref: make_ref(),
      radian: 2 * :math.pi() / (4 * opts[:pulses]),
      counter: Counter.new(),
      read_ns: nil
    }

    with :ok <- Line.subscribe(line, encoder.ref),
         :ok <- Process.sleep(@trial_ms),
         {:ok, _value} <- Line.read(line),
         do: encoder |> count_waiting() |> check_counter()
  end

  @impl Polled
  def close(encoder), do: Line.close(encoder.line)

  # Without edges, only a reading finds out that the lines are lost.
  @impl Polled
  def measure(encoder, now_ns) do
    with {:ok, _value} <- Line.read(encoder.line), {:ok, encoder} <- check_counter(encoder) do
      {rate, counter} = Counter.rate(encoder.counter, elapsed_s(encoder, now_ns))
      reading = %{position: counter.count * encoder.radian, velocity: rate * encoder.radian}
      {:ok, reading, %{encoder | counter: counter, read_ns: now_ns}}
    end
  end

  defp elapsed_s(%{read_ns: nil}, _now_ns), do: 0.0
  defp elapsed_s(%{read_ns: read_ns}, now_ns), do: (now_ns - read_ns) / 1.0e9

  @impl Polled
  def publish(reading, %{bb: bb}) do
    BB.Sensor.publish_joint_state(bb.robot, bb.path,
      positions: [reading.position],
      velocities: [reading.velocity]
    )
  end

  @impl BB.Sensor
  def handle_info({:circuits_gpio, %{ref: ref} = edge}, %{device: %{ref: ref}} = sensor) do
    case sensor.device |> count(edge) |> check_counter() do
      {:ok, encoder} -> {:noreply, %{sensor | device: encoder}}
      {:error, reason} -> {:stop, {:shutdown, reason}, sensor}
    end
  end

  def handle_info(message, sensor), do: Polled.handle_info(message, sensor)

  defp count(encoder, edge) do
    counter = Counter.edge(encoder.counter, edge.value, edge.previous_value, edge.timestamp)
    %{encoder | counter: counter}
  end

  defp count_waiting(%{ref: ref} = encoder) do
    receive do
      {:circuits_gpio, %{ref: ^ref} = edge} -> encoder |> count(edge) |> count_waiting()
    after
      0 -> encoder
    end
  end

  defp check_counter(%{line: %{spec: [a, b] = lines}} = encoder) do
    case Counter.fault(encoder.counter) do
      nil -> {:ok, encoder}
      {:one_line, :a} -> {:error, {:one_line, a, b}}
      {:one_line, :b} -> {:error, {:one_line, b, a}}
      :missed -> {:error, {:missed_edges, lines}}
    end
  end
end
