defmodule BB.Sensor.TfLuna.Registers do
  @moduledoc """
  The registers of the TF-Luna, as bytes and as terms (Benewake SJ-PM-TF-Luna A05, sections 5.4, 5.5 and appendix III). Pure.

  Numbers of 16 bits have the low byte first.
  """

  @typedoc "Distance in m, strength of the signal without unit, temperature in °C, and the time of the measurement in the chip's own ms."
  @type measurement :: %{
          distance: float(),
          signal: 0..0xFFFF,
          temperature: float(),
          tick: 0..0xFFFF
        }

  @typedoc "Whether it measures by itself or when told, and how often, in Hz."
  @type settings :: %{mode: :continuous | :triggered, frame_rate: pos_integer()}

  # 500 Hz by an integer, where that is an integer.
  @frame_rates [1, 2, 4, 5, 10, 20, 25, 50, 100, 125, 250]

  @modes %{continuous: 0, triggered: 1}

  @doc "DIST_LOW, the first of the bytes of `decode/1`."
  def dist_low, do: 0x00

  @doc "The number of bytes of a measurement."
  def measurement_size, do: 8

  @doc "SAVE, and what makes it keep the settings without power."
  def save, do: {0x20, <<0x01>>}

  @doc "SHUTDOWN/REBOOT, and what restarts the chip, which then has the settings that were saved."
  def reboot, do: {0x21, <<0x02>>}

  @doc "MODE."
  def mode, do: 0x23

  @doc "TRIG_ONE_SHOT, and what has it measure once."
  def trigger, do: {0x24, <<0x01>>}

  @doc "FPS_LOW and FPS_HIGH."
  def fps, do: 0x26

  @doc "SIGNATURE."
  def signature, do: 0x3C

  @doc "What identifies the chip."
  def identity, do: "LUNA"

  @doc "The distances that are measured, in m."
  def ranges, do: {0.2, 8.0}

  @doc "The cone's full angle in rad: 2°."
  def field_of_view, do: 2 * :math.pi() / 180

  @doc "Below it a signal is too weak for a distance."
  def least_signal, do: 100

  @doc "The signal of a receiver that sees too much light for a distance."
  def overexposed, do: 0xFFFF

  @doc """
  The slowest of the chip's rates that is above `rate_hz`, so that each reading at that rate finds a new measurement.

      iex> for rate <- [10, 99.9, 100, 200], do: BB.Sensor.TfLuna.Registers.frame_rate(rate)
      [20, 100, 125, 250]
  """
  @spec frame_rate(number()) :: pos_integer()
  def frame_rate(rate_hz), do: Enum.find(@frame_rates, &(&1 > rate_hz))

  @doc """
  MODE, and FPS.

      iex> BB.Sensor.TfLuna.Registers.encode_settings(%{mode: :triggered, frame_rate: 250})
      {<<1>>, <<0xFA, 0x00>>}
  """
  @spec encode_settings(settings()) :: {<<_::8>>, <<_::16>>}
  def encode_settings(settings),
    do: {<<Map.fetch!(@modes, settings.mode)>>, <<settings.frame_rate::16-little>>}

  @doc """
  The 8 bytes from DIST_LOW on.

      iex> BB.Sensor.TfLuna.Registers.decode(<<0x2C, 0x01, 0xE8, 0x03, 0xD2, 0x0F, 0x10, 0x27>>)
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
