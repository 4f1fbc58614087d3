defmodule BB.Bus.Sim.As5600 do
  @moduledoc """
  A simulated ams AS5600, register by register (datasheet v1-06).

  Use it to run `BB.Sensor.As5600` without the chip.

      turning = fn seconds -> [angle: 2 * seconds] end
      BB.Bus.Sim.plug("i2c-1", 0x36, {BB.Bus.Sim.As5600, source: turning})

  ## Options

  - `:source`: the magnet (`BB.Bus.Sim.Source`): its `angle` in rad (default 0.0), any number of
    turns, and `magnet`: `:good` (default), `:weak`, `:strong` or `:missing`.

  ## What is modelled

  | register | behaviour |
  |---|---|
  | 0x00–0x08 | ZMCO, ZPOS, MPOS, MANG, CONF: stored; ZMCO is read only |
  | 0x0B STATUS | MD (bit 5), ML (bit 4), MH (bit 3) |
  | 0x0C RAW ANGLE | 12 bits, at the time of the transfer |
  | 0x0E ANGLE | RAW ANGLE − ZPOS; MPOS and MANG have no effect |
  | 0x1A AGC | 128, 255 for a weak or missing magnet, 0 for a strong one |
  | 0x1B MAGNITUDE | 2048, 0 without magnet |

  A pointer at the high byte of RAW ANGLE, ANGLE or MAGNITUDE stays there, so that these can be
  read repeatedly. Without a magnet the angle is 0. Filters, hysteresis, the analog output and
  burning are not modelled.
  """
  @behaviour BB.Bus.Sim.Device

  import Bitwise

  alias BB.Bus.Sim.{Burst, Source}

  @settings 0x01..0x08
  @status 0x0B
  @raw_angle 0x0C
  @angle 0x0E
  @agc 0x1A
  @magnitude 0x1B
  @words [@raw_angle, @angle, @magnitude]

  # STATUS, AGC and MAGNITUDE.
  @magnets %{
    good: {0b0010_0000, 128, 2048},
    weak: {0b0011_0000, 255, 2048},
    strong: {0b0010_1000, 0, 2048},
    missing: {0b0001_0000, 255, 0}
  }

  @enforce_keys [:source, :powered_ns]
  defstruct [:source, :powered_ns, pointer: 0, registers: %{}]

  @impl true
  def init(opts, now_ns) do
    opts = Keyword.validate!(opts, source: [])

    {:ok,
     %__MODULE__{
       source: Source.new(opts[:source], %{angle: 0.0, magnet: :good}),
       powered_ns: now_ns
     }}
  end

  @impl true
  def write(bytes, _now_ns, chip), do: {:ok, Burst.write(bytes, chip, &put/3)}

  @impl true
  def read(count, now_ns, %{pointer: word} = chip) when word in @words do
    {bytes, chip} = Burst.read(2, chip, getter(chip, now_ns))

    {:ok, bytes |> :binary.copy(count) |> binary_part(0, count), %{chip | pointer: word}}
  end

  def read(count, now_ns, chip) do
    {bytes, chip} = Burst.read(count, chip, getter(chip, now_ns))
    {:ok, bytes, chip}
  end

  defp put(chip, register, value) when register in @settings,
    do: put_in(chip.registers[register], value)

  defp put(chip, _register, _value), do: chip

  # All bytes of a transfer are of one moment.
  defp getter(chip, now_ns) do
    quantities = Source.at(chip.source, (now_ns - chip.powered_ns) / 1.0e9)
    {status, agc, magnitude} = Map.fetch!(@magnets, quantities.magnet)
    raw = raw_angle(quantities)
    angle = raw - (register(chip, 0x01) <<< 8 ||| register(chip, 0x02)) &&& 0xFFF

    values = Map.merge(%{@status => status, @agc => agc}, word_bytes([raw, angle, magnitude]))

    fn register -> Map.get_lazy(values, register, fn -> register(chip, register) end) end
  end

  defp word_bytes(values) do
    for {register, value} <- Enum.zip(@words, values),
        <<high, low>> = <<value::16>>,
        pair <- [{register, high}, {register + 1, low}],
        into: %{},
        do: pair
  end

  defp raw_angle(%{magnet: :missing}), do: 0
  defp raw_angle(%{angle: angle}), do: round(angle / (2 * :math.pi()) * 4096) &&& 0xFFF

  defp register(chip, register), do: Map.get(chip.registers, register, 0)
end
