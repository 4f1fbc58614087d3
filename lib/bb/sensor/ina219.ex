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
        "The greatest current to measure: a number of A or a unit of current. It may cause at " <>
          "most 0.32 V across the shunt."
    ],
    voltage_range: [
      type: {:in, [16, 32]},
      default: 32,
      doc: "The greatest voltage to measure, in V: 16 or 32 (but at most 26 on the pins)."
    ]
  ]

  @schema Device.options(
            address: 0x40..0x4F,
            default: 0x40,
            doc: "0x40, or up to 0x4F by the pins A0 and A1."
          ) ++ Polled.options(rate: {1, 500}, default: 10) ++ @own

  @moduledoc """
  The Texas Instruments INA219 on I2C: voltage, current and power of a rail (SBOS448G).

  Use it for a battery or another supply.

      sensor :battery,
             {BB.Sensor.Ina219,
              bus: "i2c-1",
              shunt: ~u(10 milliohm),
              max_current: ~u(20 ampere),
              voltage_range: 16}

  It publishes `BB.Message.Sensor.PowerState`: the voltage of the rail, the current, the power,
  and the voltage across the shunt, which has the sign of the current.

  ## Options

  #{BB.Options.docs(@schema)}

  `shunt` and `max_current` set the chip's calibration. The current has steps of about
  `max_current` / 2¹⁵ (100 µA by default), and the shunt's voltage has the smallest range that
  fits: 40, 80, 160 or 320 mV.

  ## Rates

  The chip measures all the time, and averages as many samples as fit into 0.8 periods of `rate`,
  up to 128: 64 samples (68 ms) at 10 Hz, one sample (1.1 ms) above 300 Hz. A reading is published
  once, because the chip reports whether it has measured since the last read.

  ## Faults

  The chip has no identity. It is reset, and a chip without the INA219's value in its
  configuration afterwards is another chip.

  A current or a voltage beyond its range is the fault `:overflow`, because its true value is not
  known. A chip that lost its power has lost its calibration, and would show a current of 0. The
  sensor detects this and stops at once, so that the chip is set up again. A chip that has stopped
  measuring is the fault `:idle`. `BB.Sensor.Polled` describes the other faults.
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

  - `:overflow`: current or voltage are beyond their ranges, with bus and address;
  - `:idle`: the chip has not measured for some periods;
  - `:shunt_too_large`: `max_current` would cause that voltage across the shunt, in V, which is
    more than the chip can measure.
  """
  @type reason ::
          Device.reason()
          | {:overflow, String.t(), Device.address()}
          | {:idle, String.t(), Device.address()}
          | {:shunt_too_large, float()}

  @doc """
  Formats a reason as a sentence that says what to check.

      iex> BB.Sensor.Ina219.explain({:idle, "i2c-1", 0x40})
      "the chip at 0x40 on i2c-1 has stopped measuring: check its supply"
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
      "max_current causes #{volts} V across the shunt, and the chip measures at most " <>
        "#{Registers.most_shunt_voltage()} V: use a smaller shunt or a smaller max_current"

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

  # A fault fails the start, so that the sensor does not go up and down.
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
         :ok <- check_current(current, chip) do
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
      {:ok, bytes} -> bytes |> Registers.decode_bus() |> check_overflow(chip)
      {:error, reason} -> {:error, reason}
    end
  end

  defp check_overflow(%{overflow?: true}, chip),
    do: {:error, Device.fault(chip.device, :overflow)}

  defp check_overflow(bus, _chip), do: {:ok, bus}

  defp read_shunt(chip, bus) do
    with {:ok, bytes} <- Device.read(chip.device, Registers.shunt_voltage(), 2) do
      shunt_voltage = Registers.decode_shunt(bytes)

      if Registers.clipped?(chip.settings, bus.voltage, shunt_voltage),
        do: {:error, Device.fault(chip.device, :overflow)},
        else: {:ok, shunt_voltage}
    end
  end

  # A current of 0 can mean that the calibration is lost.
  defp check_current(@no_current, chip), do: expect_calibration(chip, :restarted)
  defp check_current(_current, _chip), do: :ok

  @impl Polled
  def publish(reading, sensor),
    do: BB.Sensor.publish(sensor.bb, Message.new!(PowerState, sensor.frame_id, reading))

  @impl Polled
  def close(chip), do: Device.close(chip.device)

  defp ms(us), do: ceil(us / 1000)
end
