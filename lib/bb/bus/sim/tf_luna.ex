defmodule BB.Bus.Sim.TfLuna do
  @moduledoc """
  A simulated Benewake TF-Luna in its I2C mode, register by register (SJ-PM-TF-Luna A05, appendix
  III).

  Use it to run `BB.Sensor.TfLuna` without the chip.

      BB.Bus.Sim.plug("i2c-1", 0x10, {BB.Bus.Sim.TfLuna, source: [distance: 2.5]})

  ## Options

  - `:source`: the target (`BB.Bus.Sim.Source`): `distance` in m (default 1.0), `signal`, the
    strength of the reflected light (default 1000; below 100 without a target, 65_535 for too much
    light), and `temperature` in °C (default 25.0);
  - `:reboot_ms`: how long a restart takes, during which the chip does not answer, by the bus's
    clock; default 0;
  - `:signature`: default `"LUNA"`. With another signature it is another chip.

  ## What is modelled

  | register | behaviour |
  |---|---|
  | 0x00–0x07 | the last measurement, the low byte first: distance in cm, signal, temperature in 0.01 °C, time since the start in ms. Without signal the distance is 0 |
  | 0x20 SAVE | 1: stores the settings for the next restart |
  | 0x21 REBOOT | 2: restarts the chip, which then has the stored settings |
  | 0x23 MODE | 0: continuous; 1: triggered |
  | 0x24 TRIG_ONE_SHOT | 1: one measurement, 2 ms later |
  | 0x26 FPS | measurements a second, 1 to 250 |
  | 0x3C–0x3F SIGNATURE | LUNA |

  Mode and rate take effect with a restart. Averaging, pin 6, low power and the limits of signal
  and distance are not modelled. Other registers from 0x22 to 0x31 store the bytes that are
  written. A chip that is plugged in again has the factory settings: continuous, 100 Hz.
  """
  @behaviour BB.Bus.Sim.Device

  alias BB.Bus.Sim.{Burst, SampleTimes, Source}

  @save 0x20
  @reboot 0x21
  @settings 0x22..0x31
  @mode 0x23
  @trigger 0x24
  @fps_low 0x26
  @fps_high 0x27
  @signature 0x3C..0x3F
  @factory %{0x22 => 0x10, @fps_low => 100, 0x2A => 100, 0x30 => 0x20, 0x31 => 0x03}
  @no_data <<0::8*8>>
  @shot_ns 2_000_000
  @least_signal 100

  @enforce_keys [:source, :signature, :reboot_ns, :powered_ns, :started_ns]
  defstruct [
    :source,
    :signature,
    :reboot_ns,
    :powered_ns,
    :started_ns,
    :sample_times,
    :shot_ns,
    pointer: 0,
    registers: @factory,
    saved: @factory,
    active: @factory,
    data: @no_data
  ]

  @impl true
  def init(opts, now_ns) do
    opts = Keyword.validate!(opts, source: [], reboot_ms: 0, signature: "LUNA")

    chip = %__MODULE__{
      source: Source.new(opts[:source], %{distance: 1.0, signal: 1000, temperature: 25.0}),
      signature: opts[:signature],
      reboot_ns: opts[:reboot_ms] * 1_000_000,
      powered_ns: now_ns,
      started_ns: now_ns
    }

    {:ok, start(chip, now_ns)}
  end

  @impl true
  def write(_bytes, now_ns, %{started_ns: started_ns} = chip) when now_ns < started_ns,
    do: {:nak, chip}

  def write(bytes, now_ns, chip) do
    chip = measure(chip, now_ns)
    {:ok, Burst.write(bytes, chip, &put(&1, &2, &3, now_ns))}
  end

  @impl true
  def read(_count, now_ns, %{started_ns: started_ns} = chip) when now_ns < started_ns,
    do: {:nak, chip}

  def read(count, now_ns, chip) do
    chip = measure(chip, now_ns)
    {bytes, chip} = Burst.read(count, chip, &get(chip, &1))
    {:ok, bytes, chip}
  end

  defp get(chip, register) when register < byte_size(@no_data),
    do: :binary.at(chip.data, register)

  defp get(chip, register) when register in @signature,
    do: :binary.at(chip.signature, register - @signature.first)

  defp get(_chip, @trigger), do: 0
  defp get(chip, register), do: Map.get(chip.registers, register, 0)

  defp put(chip, @save, 1, _now_ns), do: %{chip | saved: chip.registers}
  defp put(chip, @reboot, 2, now_ns), do: start(chip, now_ns + chip.reboot_ns)

  defp put(%{active: %{@mode => 1}} = chip, @trigger, 1, now_ns),
    do: %{chip | shot_ns: now_ns + @shot_ns}

  defp put(chip, register, value, _now_ns) when register in @settings and register != @trigger,
    do: put_in(chip.registers[register], value)

  defp put(chip, _register, _value, _now_ns), do: chip

  defp start(chip, started_ns) do
    chip = %{chip | started_ns: started_ns, shot_ns: nil, data: @no_data}
    chip = %{chip | registers: chip.saved, active: chip.saved}
    %{chip | sample_times: sample_times(chip.active, started_ns)}
  end

  defp sample_times(%{@mode => 1}, _started_ns), do: nil

  defp sample_times(active, started_ns) do
    rate = active[@fps_low] + 256 * Map.get(active, @fps_high, 0)
    if rate > 0, do: SampleTimes.new(div(1_000_000_000, rate), started_ns)
  end

  # Measurements.

  defp measure(%{shot_ns: shot_ns} = chip, now_ns) when shot_ns != nil and shot_ns <= now_ns,
    do: put_measurement(%{chip | shot_ns: nil}, shot_ns)

  defp measure(%{sample_times: nil} = chip, _now_ns), do: chip

  defp measure(chip, now_ns) do
    case SampleTimes.take_latest(chip.sample_times, now_ns) do
      {:ok, time_ns, times} -> put_measurement(%{chip | sample_times: times}, time_ns)
      :none -> chip
    end
  end

  defp put_measurement(chip, time_ns) do
    target = Source.at(chip.source, (time_ns - chip.powered_ns) / 1.0e9)
    distance = if target.signal < @least_signal, do: 0, else: round(target.distance * 100)
    tick = div(time_ns - chip.started_ns, 1_000_000)
    temperature = round(target.temperature * 100)

    data =
      for value <- [distance, target.signal, temperature, tick],
          into: <<>>,
          do: <<value::16-little>>

    %{chip | data: data}
  end
end
