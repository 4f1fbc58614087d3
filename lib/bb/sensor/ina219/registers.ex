defmodule BB.Sensor.Ina219.Registers do
  @moduledoc """
  Encodes and decodes the registers of the INA219 (Texas Instruments SBOS448G, sections 8.5 and
  8.6).

  `BB.Sensor.Ina219` uses it. Each register has 16 bits, the high byte first. The module is pure.

      iex> BB.Sensor.Ina219.Registers.decode_shunt(<<0x07, 0xD0>>)
      0.02

  The chip has no identity register. After a reset, CONFIGURATION has a characteristic value
  (`after_reset/0`).

  ## Calibration

  The chip multiplies its shunt voltage by CALIBRATION to get the current, which has these steps
  (equation 1): current LSB = 0.04096 V / (CALIBRATION · shunt). The step of the power is 20 steps
  of the current. The smallest steps for a greatest current are the greatest current / 2¹⁵
  (equation 2).

  ## Averaging

  The chip converts shunt and bus voltage in turn. A conversion takes 532 µs with 12 bits. The
  average of 2, 4, … 128 samples takes that many times as long (table 5).
  """
  import Bitwise

  @typedoc "The settings in CONFIGURATION, with the shunt's range in V."
  @type settings :: %{bus_range: 16 | 32, shunt_range: float(), samples: pos_integer()}

  @after_reset 0x399F
  @reset 0x8000
  @continuous 0b111

  # V, by PG.
  @shunt_ranges [{0b00, 0.04}, {0b01, 0.08}, {0b10, 0.16}, {0b11, 0.32}]

  # BADC or SADC, samples, and µs of one of the two conversions.
  @conversions [
    {0b0011, 1, 532},
    {0b1001, 2, 1060},
    {0b1010, 4, 2130},
    {0b1011, 8, 4260},
    {0b1100, 16, 8510},
    {0b1101, 32, 17_020},
    {0b1110, 64, 34_050},
    {0b1111, 128, 68_100}
  ]

  @shunt_lsb 10.0e-6
  @bus_lsb 4.0e-3
  @scale 0.04096

  @doc "Returns the address of CONFIGURATION."
  @spec configuration() :: byte()
  def configuration, do: 0x00

  @doc "Returns the address of SHUNT VOLTAGE."
  @spec shunt_voltage() :: byte()
  def shunt_voltage, do: 0x01

  @doc "Returns the address of BUS VOLTAGE, with the flags of `decode_bus/1`."
  @spec bus_voltage() :: byte()
  def bus_voltage, do: 0x02

  @doc "Returns the address of POWER. Reading it clears the conversion-ready flag."
  @spec power() :: byte()
  def power, do: 0x03

  @doc "Returns the address of CURRENT."
  @spec current() :: byte()
  def current, do: 0x04

  @doc "Returns the address of CALIBRATION. While it is 0, as after a reset, the current is 0."
  @spec calibration() :: byte()
  def calibration, do: 0x05

  @doc "Returns the bytes of CONFIGURATION that reset the chip."
  @spec reset() :: <<_::16>>
  def reset, do: <<@reset::16>>

  @doc "Returns the bytes of CONFIGURATION after power-on and reset."
  @spec after_reset() :: <<_::16>>
  def after_reset, do: <<@after_reset::16>>

  @doc "Returns the greatest voltage across the shunt that the chip can measure, in V."
  @spec most_shunt_voltage() :: float()
  def most_shunt_voltage, do: 0.32

  @doc """
  Returns the smallest range of the chip, in V, for a voltage across the shunt, or `:error` beyond
  the greatest range.

      iex> BB.Sensor.Ina219.Registers.shunt_range(0.03)
      {:ok, 0.04}
      iex> BB.Sensor.Ina219.Registers.shunt_range(0.32)
      {:ok, 0.32}
      iex> BB.Sensor.Ina219.Registers.shunt_range(0.33)
      :error
  """
  @spec shunt_range(number()) :: {:ok, float()} | :error
  def shunt_range(volts) do
    case Enum.find(@shunt_ranges, fn {_code, range} -> volts <= range * (1 + 1.0e-9) end) do
      {_code, range} -> {:ok, range}
      nil -> :error
    end
  end

  @doc """
  Returns the greatest number of samples whose conversions fit into a period of the rate.

  The conversions may take a tenth longer than typical, and must fit into 0.8 of the period.

      iex> {BB.Sensor.Ina219.Registers.samples(10), BB.Sensor.Ina219.Registers.samples(500)}
      {64, 1}
  """
  @spec samples(number()) :: pos_integer()
  def samples(rate_hz) do
    fits? = fn {_code, samples, _us} -> conversion_us(samples) * 1.1 <= 0.8e6 / rate_hz end
    @conversions |> Enum.filter(fits?) |> List.last() |> elem(1)
  end

  @doc """
  Returns the typical time to measure shunt and bus voltage, in µs.

      iex> BB.Sensor.Ina219.Registers.conversion_us(128)
      136_200
  """
  @spec conversion_us(pos_integer()) :: pos_integer()
  def conversion_us(samples) do
    {_code, _samples, us} = List.keyfind(@conversions, samples, 1)
    2 * us
  end

  @doc """
  Encodes CONFIGURATION for these settings, in the continuous mode.

      iex> alias BB.Sensor.Ina219.Registers
      iex> Registers.encode_settings(%{bus_range: 32, shunt_range: 0.32, samples: 1})
      <<0x39, 0x9F>>
      iex> Registers.encode_settings(%{bus_range: 16, shunt_range: 0.04, samples: 1})
      <<0x01, 0x9F>>
      iex> Registers.encode_settings(%{bus_range: 16, shunt_range: 0.04, samples: 128})
      <<0x07, 0xFF>>
  """
  @spec encode_settings(settings()) :: <<_::16>>
  def encode_settings(settings) do
    {gain, _range} = List.keyfind(@shunt_ranges, settings.shunt_range, 1)
    {adc, _samples, _us} = List.keyfind(@conversions, settings.samples, 1)
    range = if settings.bus_range == 32, do: 1, else: 0
    <<0::2, range::1, gain::2, adc::4, adc::4, @continuous::3>>
  end

  @doc """
  Returns CALIBRATION for steps of `current_lsb` amperes with a shunt of `shunt` ohms.

  Its lowest bit is always 0. The datasheet has the example of 1 mA and 2 mΩ:

      iex> BB.Sensor.Ina219.Registers.calibration(0.001, 0.002)
      0x5000
  """
  @spec calibration(number(), number()) :: 0..0xFFFE
  def calibration(current_lsb, shunt),
    do: min(trunc(@scale / (current_lsb * shunt) + 1.0e-6), 0xFFFE) &&& 0xFFFE

  @doc """
  Returns the step of the current, in A, for CALIBRATION with a shunt.

      iex> BB.Sensor.Ina219.Registers.current_lsb(0x5000, 0.002)
      0.001
  """
  @spec current_lsb(pos_integer(), number()) :: float()
  def current_lsb(calibration, shunt), do: @scale / (calibration * shunt)

  @doc """
  Returns CALIBRATION with the smallest steps in which `max_current` amperes can be shown.

      iex> alias BB.Sensor.Ina219.Registers
      iex> calibration = Registers.finest_calibration(15, 0.002)
      44_738
      iex> 32_767 * Registers.current_lsb(calibration, 0.002) >= 15 * 32_767 / 32_768
      true
  """
  @spec finest_calibration(number(), number()) :: 0..0xFFFE
  def finest_calibration(max_current, shunt), do: calibration(max_current / 32_768, shunt)

  @doc """
  Decodes SHUNT VOLTAGE into V, in steps of 10 µV.

      iex> BB.Sensor.Ina219.Registers.decode_shunt(<<0x83, 0x00>>)
      -0.32
  """
  @spec decode_shunt(<<_::16>>) :: float()
  def decode_shunt(<<raw::signed-16>>), do: round_to(raw * @shunt_lsb, 5)

  @doc """
  Decodes BUS VOLTAGE: the voltage in V, in steps of 4 mV, and two flags.

  `:ready?` is whether the chip has measured since the last read of POWER. `:overflow?` is whether
  current or power exceed their registers.

      iex> BB.Sensor.Ina219.Registers.decode_bus(<<0x5D98::16>>)
      %{voltage: 11.98, ready?: false, overflow?: false}
      iex> BB.Sensor.Ina219.Registers.decode_bus(<<0x5D9B::16>>)
      %{voltage: 11.98, ready?: true, overflow?: true}
  """
  @spec decode_bus(<<_::16>>) :: %{voltage: float(), ready?: boolean(), overflow?: boolean()}
  def decode_bus(<<raw::13, _::1, ready::1, overflow::1>>),
    do: %{voltage: round_to(raw * @bus_lsb, 3), ready?: ready == 1, overflow?: overflow == 1}

  @doc """
  Decodes CURRENT into A.

      iex> BB.Sensor.Ina219.Registers.decode_current(<<0x2710::16>>, 0.001)
      10.0
  """
  @spec decode_current(<<_::16>>, float()) :: float()
  def decode_current(<<raw::signed-16>>, current_lsb), do: raw * current_lsb

  @doc """
  Decodes POWER into W.

      iex> BB.Sensor.Ina219.Registers.decode_power(<<0x1766::16>>, 0.001)
      119.8
  """
  @spec decode_power(<<_::16>>, float()) :: float()
  def decode_power(<<raw::16>>, current_lsb), do: raw * 20 * current_lsb

  @doc """
  Returns whether a shunt or bus voltage is at the end of its range, so that its true value may be
  beyond it.

      iex> settings = %{bus_range: 16, shunt_range: 0.04, samples: 1}
      iex> BB.Sensor.Ina219.Registers.clipped?(settings, 12.0, -0.04)
      true
      iex> BB.Sensor.Ina219.Registers.clipped?(settings, 12.0, 0.03999)
      false
  """
  @spec clipped?(settings(), float(), float()) :: boolean()
  def clipped?(settings, voltage, shunt_voltage),
    do: voltage >= settings.bus_range or abs(shunt_voltage) >= settings.shunt_range

  # Steps without an exact float would show in the last digits.
  defp round_to(value, digits), do: Float.round(value / 1, digits)
end
