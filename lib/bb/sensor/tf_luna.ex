defmodule BB.Sensor.TfLuna do
  alias BB.Bus.I2C.Device
  alias BB.Sensor.Polled
  alias BB.Sensor.TfLuna.Registers

  @own [
    mode: [
      type: {:in, [:continuous, :triggered]},
      default: :continuous,
      doc:
        "Whether the chip measures by itself, or after each reading, which keeps several " <>
          "chips from dazzling one another."
    ],
    min_signal: [
      type: {:in, Registers.least_signal()..(Registers.overexposed() - 1)},
      default: Registers.least_signal(),
      doc: "A weaker signal, in the chip's own unit, is `:infinity`."
    ]
  ]

  @schema Device.options(
            address: 0x08..0x77,
            default: 0x10,
            doc: "0x10, unless the chip was set to another."
          ) ++ Polled.options(rate: {1, 200}, default: 50) ++ @own

  @moduledoc """
  The Benewake TF-Luna on I2C: a distance of 0.2 m to 8 m by infrared light (SJ-PM-TF-Luna A05).

  Use it as a range finder. Wire its pin 5 to ground, which selects I2C.

      sensor :front, {BB.Sensor.TfLuna, bus: "i2c-1", rate: ~u(100 hertz)}

  It publishes `BB.Message.Sensor.Range` in m, or `:infinity` when the reflected light is too weak
  or comes from beyond 8 m. Below 0.2 m the chip still measures a distance, which is below
  `min_range` and not reliable. The light is class 1, harmless to eyes, so there is nothing to
  disarm.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Rates

  A measurement has the chip's time in ms. It is published once, when that time has changed. In
  the mode `:continuous` the chip measures more often than it is read: at 1, 2, 4, 5, 10, 20, 25,
  50, 100, 125 or 250 Hz, the slowest above `rate`. In the mode `:triggered` each reading starts
  the next measurement, and a message has the time at which its measurement was started.

  The chip can change its registers while they are read. So the sensor reads until two reads are
  equal.

  ## Settings

  The chip uses a new mode or rate only after storing it and restarting. When its settings differ,
  the first start does this once. It takes a moment.

  ## Faults

  Too much light, as from the sun or a reflector nearby, is the fault `:dazzled`, because the
  distance is not known then. A chip that answers and has not measured for some periods is the
  fault `:idle`. `BB.Sensor.Polled` describes the other faults.

  A reading makes two transfers of 11 bytes: 0.5 ms at 400 kHz.
  """

  use Polled, options_schema: @schema

  alias BB.Message
  alias BB.Message.Sensor.Range

  @enforce_keys [:device, :settings, :min_signal]
  defstruct [:device, :settings, :min_signal, :tick, :started_ns]

  @most_readings 4
  @reboot_poll_ms 50
  @most_polls 60

  @typedoc """
  Why the sensor does not work: a reason of every device (`t:BB.Bus.I2C.Device.reason/0`), or,
  with bus and address,

  - `:dazzled`: the receiver gets too much light;
  - `:idle`: the chip answers, and has not measured for some periods.
  """
  @type reason :: Device.reason() | {:dazzled | :idle, String.t(), Device.address()}

  @doc """
  Formats a reason as a sentence that says what to check.

      iex> BB.Sensor.TfLuna.explain({:idle, "i2c-1", 0x10})
      "the range finder at 0x10 on i2c-1 answers, but has stopped measuring: check its supply"
  """
  @impl BB.Sensor
  @spec explain(reason()) :: String.t()
  def explain({:dazzled, bus, address}),
    do:
      "the range finder at #{Device.place(bus, address)} gets too much light: check for the " <>
        "sun, reflectors, and other range finders that point at it"

  def explain({:idle, bus, address}),
    do:
      "the range finder at #{Device.place(bus, address)} answers, but has stopped measuring: " <>
        "check its supply"

  def explain(reason), do: Device.explain(reason)

  @impl Polled
  def open(opts) do
    settings = %{mode: opts[:mode], frame_rate: Registers.frame_rate(opts[:rate])}
    chip = %__MODULE__{device: nil, settings: settings, min_signal: opts[:min_signal]}
    Device.open(opts, &start(%{chip | device: &1}))
  end

  # Too much light fails the start, so that the sensor does not go up and down. A measurement from
  # before the start is no reading.
  defp start(chip) do
    with :ok <- identify(chip),
         :ok <- set_up(chip, expect_settings(chip, :not_configured)),
         {:ok, measurement} <- read(chip),
         {:ok, _range} <- to_range(measurement, chip),
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
         :ok <- await_restart(chip, @most_polls),
         do: expect_settings(chip, :not_configured)
  end

  defp set_up(_chip, ok_or_error), do: ok_or_error

  defp await_restart(chip, polls) do
    Process.sleep(@reboot_poll_ms)

    case identify(chip) do
      {:error, {:no_answer, _bus, _address}} when polls > 1 -> await_restart(chip, polls - 1)
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

  # After its start the chip has zeros, which are no measurement.
  @impl Polled
  def measure(chip, now_ns) do
    case read(chip) do
      {:ok, %{tick: tick}} when tick in [0, chip.tick] -> no_measurement(chip, now_ns)
      {:ok, measurement} -> put_measurement(measurement, chip, now_ns)
      {:error, reason} -> {:error, reason}
    end
  end

  # Two equal reads were not changed in between. On a bus so busy that each read has a newer
  # measurement, the last one counts.
  defp read(chip) do
    with {:ok, bytes} <- read_once(chip), do: read_until_equal(bytes, chip, @most_readings - 1)
  end

  defp read_until_equal(bytes, chip, left) do
    case read_once(chip) do
      {:ok, other} when other != bytes and left > 1 -> read_until_equal(other, chip, left - 1)
      {:ok, same} -> {:ok, Registers.decode(same)}
      {:error, reason} -> {:error, reason}
    end
  end

  defp read_once(chip),
    do: Device.read(chip.device, Registers.dist_low(), Registers.measurement_size())

  defp put_measurement(measurement, chip, now_ns) do
    age_ns = age_ns(chip, now_ns)

    with {:ok, chip} <- start_measurement(%{chip | tick: measurement.tick}, now_ns) do
      case to_range(measurement, chip) do
        {:ok, range} -> {:ok, %{range: range, age_ns: age_ns}, chip}
        {:error, reason} -> {:error, reason, chip}
      end
    end
  end

  defp age_ns(%{started_ns: nil}, _now_ns), do: 0
  defp age_ns(%{started_ns: started_ns}, now_ns), do: now_ns - started_ns

  defp no_measurement(chip, now_ns) do
    with {:ok, chip} <- start_measurement(chip, now_ns),
         do: {:none, Device.fault(chip.device, :idle), chip}
  end

  defp start_measurement(%{settings: %{mode: :continuous}} = chip, _now_ns), do: {:ok, chip}

  defp start_measurement(chip, now_ns) do
    with :ok <- command(chip, Registers.trigger()), do: {:ok, %{chip | started_ns: now_ns}}
  end

  defp to_range(measurement, chip) do
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
