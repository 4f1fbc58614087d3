defmodule BB.Test.Chaos.Soak.Trend do
  @moduledoc """
  Decides whether a figure grows while a program runs. Pure.

  The growth is the slope of the median pair of samples (Theil-Sen estimator), over the whole
  time. Temporary garbage and single peaks do not count, steady growth does.
  """

  @most_samples 150

  @typedoc "Samples `{second, value}`, in their order."
  @type samples :: [{number(), number()}]

  @doc """
  Returns the growth between the first sample and the last.

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

  @doc "Tells whether it grew by no more than `floor`, or than that share of its median."
  @spec flat?(samples(), number(), float()) :: boolean()
  def flat?(samples, floor, share), do: gain(samples) <= max(floor, share * middle(samples))

  @doc "Returns the median of the values."
  @spec middle(samples()) :: number()
  def middle(samples), do: samples |> Enum.map(&elem(&1, 1)) |> median()

  defp slope(samples) do
    slopes = for {t, a} <- samples, {u, b} <- samples, u > t, do: (b - a) / (u - t)
    if slopes == [], do: 0.0, else: median(slopes)
  end

  # The number of pairs is quadratic.
  defp thin(samples) do
    step = max(div(length(samples), @most_samples), 1)
    Enum.take_every(samples, step)
  end

  defp median(values) do
    sorted = Enum.sort(values)
    Enum.at(sorted, div(length(sorted), 2))
  end
end
