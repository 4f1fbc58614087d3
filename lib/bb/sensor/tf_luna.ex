defmodule BB.Sensor.TfLuna do
  alias BB.Bus.I2C.Device
  alias BB.Sensor.Polled
  alias BB.Sensor.TfLuna.Registers

  @own [
    mode: [
      type: {:in, [:continuous, :triggered]},
      default: :continuous,
      doc:
        "Whether the chip measures by itself, or each time that it was read, which keeps several of them from dazzling one another."
    ],
    min_signal: [
      type: {:in, Registers.least_signal()..(Registers.overexposed() - 1)},
      default: Registers.least_signal(),
      doc: "A weaker signal, in the chip's own measure, is taken for nothing in reach."
    ]
  ]

  @schema Device.options(
            address: 0x08..0x77,
            default: 0x10,
            doc: "0x10, unless the chip was told another."
          ) ++ Polled.options(rate: {1, 200}, default: 50) ++ @own

  @moduledoc """
  The Benewake TF-Luna: a distance of 0.2 m to 8 m, by infrared light, on I2C (SJ-PM-TF-Luna A05; its pin 5 must be wired to ground).

      sensor :front, {BB.Sensor.TfLuna, bus: "i2c-1", rate: ~u(100 hertz)}

  Publishes `BB.Message.Sensor.Range`: in m, and `:infinity` when what comes back is too weak, or comes from beyond 8 m. Below 0.2 m the chip still
  shows a distance, which is nearer than `min_range` and not to be relied on. The light is class 1, harmless to eyes, so there is
  nothing to disarm.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Rates
  A measurement has the chip's time, in ms, and is published once: when that has changed since the last one. In the mode `:continuous`
  the chip is set to measure more often than it is read: at 1, 2, 4, 5, 10, 20, 25, 50, 100, 125 or 250 Hz, the slowest above `rate`. In the mode
  `:triggered` each reading orders the next measurement, and a message has the time at which its own was ordered.

  The chip may change its registers while they are read. So it is read until it shows the same twice.

  ## Settings
  The chip takes a new mode or rate only when it has kept them and was restarted. When they are not as they should be, the first start
  does that, once; it takes a moment.

  ## What goes wrong
  Too much light, as from the sun or a reflector nearby, is a fault, `:dazzled`: nothing is known then. So is a chip that answers and has not
  measured for some periods, `:idle`. For the rest see `BB.Sensor.Polled`.

  A reading costs two transfers of 11 bytes, 0.5 ms at 400 kHz.
  """

  use Polled, options_schema: @schema

  alias BB.Message
  alias BB.Message.Sensor.Range

  @enforce_keys [:device, :settings, :min_signal]
  defstruct [:device, :settings, :min_signal, :tick, :ordered_ns]

  @most_readings 4
  @reboot_poll_ms 50
  @most_polls 60

  @typedoc """
  Why the sensor does not work: a reason of every device (`t:BB.Bus.I2C.Device.reason/0`), or, with bus and address,

  - `:dazzled`: the receiver sees too much light;
  - `:idle`: the chip answers, and has not measured for some periods.
  """
  @type reason :: Device.reason() | {:dazzled | :idle, String.t(), Device.address()}

  @doc """
  A reason in a sentence that says what to look at.

      iex> BB.Sensor.TfLuna.explain({:dazzled, "i2c-1", 0x10})
      "the range finder at 0x10 on i2c-1 sees too much light: look for the sun, a reflector, or another one that shines at it"
  """
  @impl BB.Sensor
  @spec explain(reason()) :: String.t()
  def explain({:dazzled, bus, address}),
    do:
      "the range finder at #{Device.place(bus, address)} sees too much light: " <>
        "look for the sun, a reflector, or another one that shines at it"

  def explain({:idle, bus, address}),
    do:
      "the range finder at #{Device.place(bus, address)} answers, but has stopped measuring: check its supply"

  def explain(reason), do: Device.explain(reason)

  @impl Polled
  def open(opts) do
    settings = %{mode: opts[:mode], frame_rate: Registers.frame_rate(opts[:rate])}
    chip = %__MODULE__{device: nil, settings: settings, min_signal: opts[:min_signal]}
    Device.open(opts, &start(%{chip | device: &1}))
  end

  # Too much light from the start is the start's fault. What was measured before it is no reading.
  defp start(chip) do
    with :ok <- identify(chip),
         :ok <- set_up(chip, expect_settings(chip, :not_configured)),
         {:ok, measurement} <- read(chip),
         {:ok, _range} <- judge(measurement, chip),
         do: {:ok, %{chip | tick: measurement.tick}}
  end

  defp identify(chip),
    do: Device.identify(chip.device, Registers.signature(), Registers.identity())

  defp set_up(chip, {:error, {:not_configured, _bus, _address}}) do
    {mode, fps} = Registers.encode_settings(chip.settings)

    with :ok <- Device.write(chip.device, Registers.mode(), mode),
         :ok <- Device.write(chip.device, Registers.fps(), fps),
         :ok <- command(chip, Registers.save()),
         :ok <- command(chip, Registers.reboot()),
         :ok <- await(chip, @most_polls),
         do: expect_settings(chip, :not_configured)
  end

  defp set_up(_chip, ok_or_error), do: ok_or_error

  defp await(chip, polls) do
    Process.sleep(@reboot_poll_ms)

    case identify(chip) do
      {:error, {:no_answer, _bus, _address}} when polls > 1 -> await(chip, polls - 1)
      answer -> answer
    end
  end

  @impl Polled
  def check(chip), do: expect_settings(chip, :restarted)

  defp expect_settings(chip, otherwise) do
    {mode, fps} = Registers.encode_settings(chip.settings)

    with :ok <- Device.expect(chip.device, Registers.mode(), mode, otherwise),
         do: Device.expect(chip.device, Registers.fps(), fps, otherwise)
  end

  defp command(chip, {register, bytes}), do: Device.write(chip.device, register, bytes)

  # At its start the chip shows zeros, which are no measurement of an empty room.
  @impl Polled
  def measure(chip, now_ns) do
    case read(chip) do
      {:ok, %{tick: tick}} when tick in [0, chip.tick] -> idle(chip, now_ns)
      {:ok, measurement} -> measured(measurement, chip, now_ns)
      {:error, reason} -> {:error, reason}
    end
  end

  # Two that are the same were not changed meanwhile. On a bus so busy that each finds a newer measurement, the last must do.
  defp read(chip) do
    with {:ok, bytes} <- read_once(chip), do: read_again(bytes, chip, @most_readings - 1)
  end

  defp read_again(bytes, chip, left) do
    case read_once(chip) do
      {:ok, other} when other != bytes and left > 1 -> read_again(other, chip, left - 1)
      {:ok, same} -> {:ok, Registers.decode(same)}
      {:error, reason} -> {:error, reason}
    end
  end

  defp read_once(chip),
    do: Device.read(chip.device, Registers.dist_low(), Registers.measurement_size())

  defp measured(measurement, chip, now_ns) do
    age_ns = age_ns(chip, now_ns)

    with {:ok, chip} <- order(%{chip | tick: measurement.tick}, now_ns) do
      case judge(measurement, chip) do
        {:ok, range} -> {:ok, %{range: range, age_ns: age_ns}, chip}
        {:error, reason} -> {:error, reason, chip}
      end
    end
  end

  defp age_ns(%{ordered_ns: nil}, _now_ns), do: 0
  defp age_ns(%{ordered_ns: ordered_ns}, now_ns), do: now_ns - ordered_ns

  defp idle(chip, now_ns) do
    with {:ok, chip} <- order(chip, now_ns),
         do: {:none, Device.fault(chip.device, :idle), chip}
  end

  defp order(%{settings: %{mode: :continuous}} = chip, _now_ns), do: {:ok, chip}

  defp order(chip, now_ns) do
    with :ok <- command(chip, Registers.trigger()), do: {:ok, %{chip | ordered_ns: now_ns}}
  end

  defp judge(measurement, chip) do
    {_nearest, farthest} = Registers.ranges()

    cond do
      measurement.signal == Registers.overexposed() ->
        {:error, Device.fault(chip.device, :dazzled)}

      measurement.signal < chip.min_signal or measurement.distance > farthest ->
        {:ok, :infinity}

      true ->
        {:ok, measurement.distance}
    end
  end

  @impl Polled
  def publish(reading, sensor) do
    {nearest, farthest} = Registers.ranges()

    range = [
      radiation_type: :infrared,
      field_of_view: Registers.field_of_view(),
      min_range: nearest,
      max_range: farthest,
      range: reading.range
    ]

    time_ns = System.monotonic_time(:nanosecond) - reading.age_ns
    message = Message.new!(Range, sensor.frame_id, range, monotonic_time: time_ns)
    BB.Sensor.publish(sensor.bb, message)
  end

  @impl Polled
  def close(chip), do: Device.close(chip.device)
end
