defmodule BB.Sensor.TfLuna.Registers do
  @moduledoc """
  Encodes and decodes the registers of the TF-Luna (Benewake SJ-PM-TF-Luna A05, sections 5.4, 5.5
  and appendix III).

  `BB.Sensor.TfLuna` uses it. Numbers of 16 bits have the low byte first. The module is pure.

      iex> BB.Sensor.TfLuna.Registers.frame_rate(99.9)
      100
  """

  @typedoc """
  A measurement: distance in m, strength of the signal without unit, temperature in °C, and the
  time of the measurement in ms of the chip.
  """
  @type measurement :: %{
          distance: float(),
          signal: 0..0xFFFF,
          temperature: float(),
          tick: 0..0xFFFF
        }

  @typedoc "The mode of the chip, and its rate in Hz."
  @type settings :: %{mode: :continuous | :triggered, frame_rate: pos_integer()}

  # The integers among 500 Hz divided by an integer.
  @frame_rates [1, 2, 4, 5, 10, 20, 25, 50, 100, 125, 250]

  @modes %{continuous: 0, triggered: 1}

  @doc "Returns the address of DIST_LOW, the first of the bytes of `decode/1`."
  @spec dist_low() :: byte()
  def dist_low, do: 0x00

  @doc "Returns the number of bytes of a measurement."
  @spec measurement_size() :: pos_integer()
  def measurement_size, do: 8

  @doc "Returns the address of SAVE, and the value that stores the settings."
  @spec save() :: {byte(), binary()}
  def save, do: {0x20, <<0x01>>}

  @doc """
  Returns the address of SHUTDOWN/REBOOT, and the value that restarts the chip with the stored
  settings.
  """
  @spec reboot() :: {byte(), binary()}
  def reboot, do: {0x21, <<0x02>>}

  @doc "Returns the address of MODE."
  @spec mode() :: byte()
  def mode, do: 0x23

  @doc "Returns the address of TRIG_ONE_SHOT, and the value that starts one measurement."
  @spec trigger() :: {byte(), binary()}
  def trigger, do: {0x24, <<0x01>>}

  @doc "Returns the address of FPS_LOW, which FPS_HIGH follows."
  @spec fps() :: byte()
  def fps, do: 0x26

  @doc "Returns the address of SIGNATURE."
  @spec signature() :: byte()
  def signature, do: 0x3C

  @doc "Returns the signature of the chip."
  @spec identity() :: String.t()
  def identity, do: "LUNA"

  @doc "Returns the smallest and the greatest distance of the chip, in m."
  @spec ranges() :: {float(), float()}
  def ranges, do: {0.2, 8.0}

  @doc "Returns the cone's full angle in rad: 2°."
  @spec field_of_view() :: float()
  def field_of_view, do: 2 * :math.pi() / 180

  @doc "Returns the least signal for a distance."
  @spec least_signal() :: pos_integer()
  def least_signal, do: 100

  @doc "Returns the signal of a receiver that gets too much light for a distance."
  @spec overexposed() :: pos_integer()
  def overexposed, do: 0xFFFF

  @doc """
  Returns the slowest of the chip's rates above `rate_hz`, so that each reading at that rate is a
  new measurement.

      iex> for rate <- [10, 100, 200], do: BB.Sensor.TfLuna.Registers.frame_rate(rate)
      [20, 125, 250]
  """
  @spec frame_rate(number()) :: pos_integer()
  def frame_rate(rate_hz), do: Enum.find(@frame_rates, &(&1 > rate_hz))

  @doc """
  Encodes MODE and FPS.

      iex> BB.Sensor.TfLuna.Registers.encode_settings(%{mode: :triggered, frame_rate: 250})
      {<<1>>, <<0xFA, 0x00>>}
  """
  @spec encode_settings(settings()) :: {<<_::8>>, <<_::16>>}
  def encode_settings(settings),
    do: {<<Map.fetch!(@modes, settings.mode)>>, <<settings.frame_rate::16-little>>}

  @doc """
  Decodes the 8 bytes from DIST_LOW on.

      iex> bytes = <<0x2C, 0x01, 0xE8, 0x03, 0xD2, 0x0F, 0x10, 0x27>>
      iex> BB.Sensor.TfLuna.Registers.decode(bytes)
      %{distance: 3.0, signal: 1000, temperature: 40.5, tick: 10_000}
  """
  @spec decode(<<_::64>>) :: measurement()
  def decode(
        <<centimeters::16-little, signal::16-little, temperature::16-little-signed,
          tick::16-little>>
      ) do
    %{
      distance: centimeters / 100,
      signal: signal,
      temperature: temperature / 100,
      tick: tick
    }
  end
end
