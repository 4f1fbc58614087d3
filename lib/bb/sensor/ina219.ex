defmodule BB.Sensor.Ina219 do
  alias BB.Bus.I2C.Device
  alias BB.Sensor.Ina219.Registers
  alias BB.Sensor.Polled

  @own [
    shunt: [
      type: BB.Unit.option(:ohm, 1.0e-4, 10),
      default: 0.1,
      doc: "The shunt's resistance: a number of Ω or a unit of resistance."
    ],
    max_current: [
      type: BB.Unit.option(:ampere, 0.001, 1000),
      default: 3.2,
      doc:
        "The greatest current to be measured: a number of A or a unit of current. With the shunt it is at most 0.32 V."
    ],
    voltage_range: [
      type: {:in, [16, 32]},
      default: 32,
      doc:
        "The greatest voltage to be measured, in V: 16 or 32 (but no more than 26 on the pins)."
    ]
  ]

  @schema Device.options(
            address: 0x40..0x4F,
            default: 0x40,
            doc: "0x40, or up to 0x4F as the pins A0 and A1 say."
          ) ++ Polled.options(rate: {1, 500}, default: 10) ++ @own

  @moduledoc """
  The Texas Instruments INA219: voltage, current and power of a rail, on I2C (SBOS448G).

      sensor :battery, {BB.Sensor.Ina219, bus: "i2c-1", shunt: ~u(10 milliohm), max_current: ~u(20 ampere), voltage_range: 16}

  Publishes `BB.Message.Sensor.PowerState`: the rail's voltage, the current, whose sign is that of the voltage across the shunt, the
  power, and the voltage across the shunt.

  ## Options

  #{BB.Options.docs(@schema)}

  `shunt` and `max_current` give the chip's calibration: the current has steps of about `max_current` / 2¹⁵ (100 µA by default), and the
  shunt's voltage the smallest range that fits, 40, 80, 160 or 320 mV.

  ## Rates
  The chip measures all the time, and averages as many samples as fit into 0.8 periods of `rate`, up to 128: 64 samples (68 ms) at 10 Hz, one
  (1.1 ms) above 300 Hz. A reading is published once: the chip says whether it has measured since it was last read.

  ## What goes wrong
  The chip has no identity to ask for. It is reset, and what has not the INA219's value in its configuration then is another chip.

  A current or a voltage beyond what was set up is no reading but a fault, `:overflow`: the true value is not known. A chip that lost
  its power has lost its calibration, and would show a current of 0: that is noticed, and the sensor stops at once to set it up again.
  One that has stopped measuring is a fault, `:idle`. For the rest see `BB.Sensor.Polled`.
  """

  use Polled, options_schema: @schema

  alias BB.Message
  alias BB.Message.Sensor.PowerState

  @enforce_keys [:device, :settings, :calibration, :current_lsb]
  defstruct [:device, :settings, :calibration, :current_lsb]

  @reset_ms 1
  @no_current <<0::16>>

  @typedoc """
  Why the sensor does not work: a reason of every device (`t:BB.Bus.I2C.Device.reason/0`), or

  - `:overflow`: current or voltage are beyond their ranges; bus, then address;
  - `:idle`: the chip has not measured for some periods;
  - `:shunt_too_large`: with `max_current` the shunt would have that voltage, in V, more than the chip can measure.
  """
  @type reason ::
          Device.reason()
          | {:overflow, String.t(), Device.address()}
          | {:idle, String.t(), Device.address()}
          | {:shunt_too_large, float()}

  @doc """
  A reason in a sentence that says what to look at.

      iex> BB.Sensor.Ina219.explain({:overflow, "i2c-1", 0x40})
      "current or voltage at 0x40 on i2c-1 are beyond what was set up: check the load, and the options max_current, shunt and voltage_range"
      iex> BB.Sensor.Ina219.explain({:shunt_too_large, 0.5})
      "max_current makes 0.5 V across the shunt, and the chip measures at most 0.32 V: take a smaller shunt or a smaller max_current"
  """
  @impl BB.Sensor
  @spec explain(reason()) :: String.t()
  def explain({:overflow, bus, address}),
    do:
      "current or voltage at #{Device.place(bus, address)} are beyond what was set up: " <>
        "check the load, and the options max_current, shunt and voltage_range"

  def explain({:idle, bus, address}),
    do: "the chip at #{Device.place(bus, address)} has stopped measuring: check its supply"

  def explain({:shunt_too_large, volts}),
    do:
      "max_current makes #{volts} V across the shunt, and the chip measures at most #{Registers.most_shunt_voltage()} V: " <>
        "take a smaller shunt or a smaller max_current"

  def explain(reason), do: Device.explain(reason)

  @impl Polled
  def open(opts) do
    with {:ok, settings} <- settings(opts),
         do: Device.open(opts, &start(new(&1, settings, opts)))
  end

  defp settings(opts) do
    volts = opts[:max_current] * opts[:shunt]

    case Registers.shunt_range(volts) do
      {:ok, range} -> {:ok, settings(opts, range)}
      :error -> {:error, {:shunt_too_large, Float.round(volts / 1, 6)}}
    end
  end

  defp settings(opts, shunt_range),
    do: %{
      bus_range: opts[:voltage_range],
      shunt_range: shunt_range,
      samples: Registers.samples(opts[:rate])
    }

  defp new(device, settings, opts) do
    calibration = Registers.finest_calibration(opts[:max_current], opts[:shunt])

    %__MODULE__{
      device: device,
      settings: settings,
      calibration: calibration,
      current_lsb: Registers.current_lsb(calibration, opts[:shunt])
    }
  end

  # A fault that is there from the start is the start's.
  defp start(chip) do
    with :ok <- Device.write(chip.device, Registers.configuration(), Registers.reset()),
         :ok <- Process.sleep(@reset_ms),
         :ok <- Device.identify(chip.device, Registers.configuration(), Registers.after_reset()),
         :ok <- configure(chip),
         :ok <- Process.sleep(ms(Registers.conversion_us(chip.settings.samples) * 1.1)),
         {:ok, bus} <- read_bus(chip),
         {:ok, _shunt_voltage} <- read_shunt(chip, bus),
         do: {:ok, chip}
  end

  defp configure(chip) do
    with :ok <- Device.write(chip.device, Registers.calibration(), <<chip.calibration::16>>),
         :ok <- Device.write(chip.device, Registers.configuration(), configuration(chip)),
         do: expect_settings(chip, :not_configured)
  end

  @impl Polled
  def check(chip), do: expect_settings(chip, :restarted)

  defp expect_settings(chip, otherwise) do
    with :ok <-
           Device.expect(chip.device, Registers.configuration(), configuration(chip), otherwise),
         do: expect_calibration(chip, otherwise)
  end

  defp expect_calibration(chip, otherwise),
    do: Device.expect(chip.device, Registers.calibration(), <<chip.calibration::16>>, otherwise)

  defp configuration(chip), do: Registers.encode_settings(chip.settings)

  @impl Polled
  def measure(chip, _now_ns) do
    case read_bus(chip) do
      {:ok, %{ready?: true} = bus} -> read_rest(chip, bus)
      {:ok, _bus} -> {:none, Device.fault(chip.device, :idle), chip}
      {:error, reason} -> {:error, reason}
    end
  end

  defp read_rest(chip, bus) do
    with {:ok, shunt_voltage} <- read_shunt(chip, bus),
         {:ok, current} <- Device.read(chip.device, Registers.current(), 2),
         {:ok, power} <- Device.read(chip.device, Registers.power(), 2),
         :ok <- believe(current, chip) do
      reading = %{
        voltage: bus.voltage,
        shunt_voltage: shunt_voltage,
        current: Registers.decode_current(current, chip.current_lsb),
        power: Registers.decode_power(power, chip.current_lsb)
      }

      {:ok, reading, chip}
    end
  end

  defp read_bus(chip) do
    case Device.read(chip.device, Registers.bus_voltage(), 2) do
      {:ok, bytes} -> bytes |> Registers.decode_bus() |> overflow(chip)
      {:error, reason} -> {:error, reason}
    end
  end

  defp overflow(%{overflow?: true}, chip), do: {:error, Device.fault(chip.device, :overflow)}
  defp overflow(bus, _chip), do: {:ok, bus}

  defp read_shunt(chip, bus) do
    with {:ok, bytes} <- Device.read(chip.device, Registers.shunt_voltage(), 2) do
      shunt_voltage = Registers.decode_shunt(bytes)

      if Registers.clipped?(chip.settings, bus.voltage, shunt_voltage),
        do: {:error, Device.fault(chip.device, :overflow)},
        else: {:ok, shunt_voltage}
    end
  end

  # Without its calibration the chip shows no current.
  defp believe(@no_current, chip), do: expect_calibration(chip, :restarted)
  defp believe(_current, _chip), do: :ok

  @impl Polled
  def publish(reading, sensor),
    do: BB.Sensor.publish(sensor.bb, Message.new!(PowerState, sensor.frame_id, reading))

  @impl Polled
  def close(chip), do: Device.close(chip.device)

  defp ms(us), do: ceil(us / 1000)
end
