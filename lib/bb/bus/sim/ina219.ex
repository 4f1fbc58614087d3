defmodule BB.Bus.Sim.Ina219 do
  @moduledoc """
  A simulated Texas Instruments INA219, register by register (SBOS448G).

  Use it to run `BB.Sensor.Ina219` without the chip.

      BB.Bus.Sim.plug("i2c-1", 0x40, {BB.Bus.Sim.Ina219, source: [voltage: 11.1, current: 1.5]})

  ## Options

  - `:source`: the rail (`BB.Bus.Sim.Source`): `voltage` in V (default 12.0) and `current` in A
    (default 1.0), negative for the other direction;
  - `:shunt`: the resistance in Ω through which the current flows; default 0.1;
  - `:reset_value`: CONFIGURATION after power-on; default 0x399F. With another value it is another
    chip.

  ## What is modelled

  | register | behaviour |
  |---|---|
  | 0x00 CONFIGURATION | RST (bit 15); BRNG and PG limit the voltages; BADC, SADC and MODE set the times of both conversions, as in table 5. Writing it starts a conversion and clears CNVR |
  | 0x01 SHUNT VOLTAGE | 10 µV a step, signed, limited by PG |
  | 0x02 BUS VOLTAGE | 4 mV a step from bit 3 on, limited by BRNG; CNVR (bit 1): measured since the last read of POWER; OVF (bit 0): current or power exceed 16 bits |
  | 0x03 POWER | CURRENT · BUS VOLTAGE / 5000; reading it clears CNVR |
  | 0x04 CURRENT | SHUNT VOLTAGE · CALIBRATION / 4096 |
  | 0x05 CALIBRATION | bit 0 is always 0; takes effect at the next conversion |

  The mean of several samples is the value at their end. The chip does not acknowledge other
  registers.
  """
  @behaviour BB.Bus.Sim.Device

  import Bitwise

  alias BB.Bus.Sim.{SampleTimes, Source}

  @configuration 0
  @shunt_voltage 1
  @bus_voltage 2
  @power 3
  @current 4
  @calibration 5

  @enforce_keys [:source, :shunt, :reset_value, :configuration, :powered_ns]
  defstruct [
    :source,
    :shunt,
    :reset_value,
    :configuration,
    :powered_ns,
    :sample_times,
    pointer: 0,
    calibration: 0,
    shunt_voltage: 0,
    bus_voltage: 0,
    current: 0,
    power: 0,
    ready?: false,
    overflow?: false
  ]

  @impl true
  def init(opts, now_ns) do
    opts = Keyword.validate!(opts, source: [], shunt: 0.1, reset_value: 0x399F)

    chip = %__MODULE__{
      source: Source.new(opts[:source], %{voltage: 12.0, current: 1.0}),
      shunt: opts[:shunt],
      reset_value: opts[:reset_value],
      configuration: opts[:reset_value],
      powered_ns: now_ns
    }

    {:ok, start_conversions(chip, now_ns)}
  end

  @impl true
  def write(<<pointer>>, _now_ns, chip) when pointer <= @calibration,
    do: {:ok, %{chip | pointer: pointer}}

  def write(<<pointer, value::16>>, now_ns, chip) when pointer <= @calibration,
    do: {:ok, %{chip | pointer: pointer} |> convert(now_ns) |> put(pointer, value, now_ns)}

  def write(_other, _now_ns, chip), do: {:nak, chip}

  @impl true
  def read(2, now_ns, chip) do
    chip = convert(chip, now_ns)
    {:ok, <<get(chip, chip.pointer)::16>>, after_read(chip, chip.pointer)}
  end

  def read(_count, _now_ns, chip), do: {:nak, chip}

  defp put(chip, @configuration, value, now_ns) when (value &&& 0x8000) != 0 do
    {:ok, fresh} = init([shunt: chip.shunt, reset_value: chip.reset_value], chip.powered_ns)

    start_conversions(%{fresh | source: chip.source}, now_ns)
  end

  defp put(chip, @configuration, value, now_ns),
    do: start_conversions(%{chip | configuration: value, ready?: false}, now_ns)

  defp put(chip, @calibration, value, _now_ns), do: %{chip | calibration: value &&& 0xFFFE}
  defp put(chip, _read_only, _value, _now_ns), do: chip

  defp get(chip, @configuration), do: chip.configuration
  defp get(chip, @shunt_voltage), do: chip.shunt_voltage
  defp get(chip, @power), do: chip.power
  defp get(chip, @current), do: chip.current
  defp get(chip, @calibration), do: chip.calibration

  defp get(chip, @bus_voltage),
    do: chip.bus_voltage <<< 3 ||| bit(chip.ready?) <<< 1 ||| bit(chip.overflow?)

  defp bit(flag?), do: if(flag?, do: 1, else: 0)

  defp after_read(chip, @power), do: %{chip | ready?: false}
  defp after_read(chip, _register), do: chip

  # Conversions.

  defp start_conversions(chip, now_ns) do
    <<_::5, bus_adc::4, shunt_adc::4, mode::3>> = <<chip.configuration::16>>
    shunt_ns = if (mode &&& 0b001) != 0, do: conversion_ns(shunt_adc), else: 0
    bus_ns = if (mode &&& 0b010) != 0, do: conversion_ns(bus_adc), else: 0

    if shunt_ns + bus_ns > 0,
      do: %{chip | sample_times: SampleTimes.new(shunt_ns + bus_ns, now_ns)},
      else: %{chip | sample_times: nil}
  end

  defp conversion_ns(code) do
    case <<code::4>> do
      <<0::1, _::1, bits::2>> -> elem({84_000, 148_000, 276_000, 532_000}, bits)
      <<1::1, 0::3>> -> 532_000
      <<1::1, log2::3>> -> elem({1060, 2130, 4260, 8510, 17_020, 34_050, 68_100}, log2 - 1) * 1000
    end
  end

  defp convert(%{sample_times: nil} = chip, _now_ns), do: chip

  defp convert(chip, now_ns) do
    case SampleTimes.take_latest(chip.sample_times, now_ns) do
      {:ok, time_ns, times} ->
        put_measurement(%{chip | sample_times: next_times(times, chip)}, time_ns)

      :none ->
        chip
    end
  end

  # In the triggered mode it converts once.
  defp next_times(times, chip),
    do: if((chip.configuration &&& 0b100) != 0, do: times, else: nil)

  defp put_measurement(chip, time_ns) do
    rail = Source.at(chip.source, (time_ns - chip.powered_ns) / 1.0e9)
    <<_::2, range::1, gain::2, _::11>> = <<chip.configuration::16>>
    limit = 4000 <<< gain
    shunt = (rail.current * chip.shunt / 10.0e-6) |> round() |> max(-limit) |> min(limit)
    bus = (rail.voltage / 4.0e-3) |> round() |> max(0) |> min(4000 <<< range)
    current = div(shunt * chip.calibration, 4096)
    power = div(abs(current) * bus, 5000)

    %{
      chip
      | shunt_voltage: shunt,
        bus_voltage: bus,
        current: current,
        power: power,
        ready?: true,
        overflow?: current not in -32_768..32_767 or power > 0xFFFF
    }
  end
end
