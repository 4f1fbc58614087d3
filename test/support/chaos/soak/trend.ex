defmodule BB.Test.Chaos.Soak.Trend do
  @moduledoc """
  Whether a figure stays what it is while a program runs. Pure.

  What it gained is the slope that the median pair of samples has (Theil and Sen's), over the whole time: garbage that comes and
  goes and single peaks do not count, a steady gain does.
  """

  @most_samples 150

  @typedoc "Samples `{second, value}`, in their order."
  @type samples :: [{number(), number()}]

  @doc """
  What it gained between the first sample and the last.

      iex> BB.Test.Chaos.Soak.Trend.gain(for second <- 0..10, do: {second, 100 + 2 * second})
      20.0
      iex> BB.Test.Chaos.Soak.Trend.gain([{0, 5}, {1, 5}, {2, 900}, {3, 5}, {4, 5}])
      0.0
  """
  @spec gain(samples()) :: float()
  def gain(samples) do
    {from, _} = hd(samples)
    {to, _} = List.last(samples)
    slope(thin(samples)) * (to - from)
  end

  @doc "Whether it gained no more than `floor`, or than that share of its median."
  @spec flat?(samples(), number(), float()) :: boolean()
  def flat?(samples, floor, share), do: gain(samples) <= max(floor, share * middle(samples))

  @doc "The median of the values."
  @spec middle(samples()) :: number()
  def middle(samples), do: samples |> Enum.map(&elem(&1, 1)) |> median()

  defp slope(samples) do
    slopes = for {t, a} <- samples, {u, b} <- samples, u > t, do: (b - a) / (u - t)
    if slopes == [], do: 0.0, else: median(slopes)
  end

  # Pairs are many.
  defp thin(samples) do
    step = max(div(length(samples), @most_samples), 1)
    Enum.take_every(samples, step)
  end

  defp median(values) do
    sorted = Enum.sort(values)
    Enum.at(sorted, div(length(sorted), 2))
  end
end
