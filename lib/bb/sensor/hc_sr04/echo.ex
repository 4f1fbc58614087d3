defmodule BB.Sensor.HcSr04.Echo do
  @moduledoc """
  Converts the width of an HC-SR04's echo into a range.

  `BB.Sensor.HcSr04` uses it. Its tests have the numbers of the datasheet. The module is pure.

      iex> BB.Sensor.HcSr04.Echo.range(38_000_000, 343.2, {0.02, 4.0})
      :infinity
  """

  @doc """
  Returns the distance to an obstacle, to which sound goes and from which it comes back.

      iex> BB.Sensor.HcSr04.Echo.distance(1_000_000, 340.0)
      0.17
  """
  @spec distance(width_ns :: non_neg_integer(), speed_of_sound :: float()) :: float()
  def distance(width_ns, speed_of_sound), do: width_ns / 1.0e9 * speed_of_sound / 2

  @doc """
  Returns the range in m from `least` on, `:infinity` beyond `most`, or `:too_short` for a width
  that no echo has.
  """
  @spec range(non_neg_integer(), float(), {float(), float()}) :: float() | :infinity | :too_short
  def range(width_ns, speed_of_sound, {least, most}) do
    case distance(width_ns, speed_of_sound) do
      distance when distance > most -> :infinity
      distance when distance < least -> :too_short
      distance -> distance
    end
  end
end
