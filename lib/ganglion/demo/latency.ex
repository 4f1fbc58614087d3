defmodule Ganglion.Demo.Latency do
  @moduledoc """
  A distribution of durations in bounded memory, however far apart they are: counts by steps of
  10 µs, and of 1 % at most from 10 ms on.

      iex> latency = Enum.reduce(1..100, Ganglion.Demo.Latency.new(), &Ganglion.Demo.Latency.add(&2, &1 * 1_000_000))
      iex> {Ganglion.Demo.Latency.quantile_us(latency, 0.5), Ganglion.Demo.Latency.quantile_us(latency, 0.99)}
      {50_000, 99_000}
      iex> Ganglion.Demo.Latency.quantile_us(Ganglion.Demo.Latency.new(), 0.5)
      nil
  """

  @step_ns 10_000
  # A tenth of them from one power of ten to the next: steps of 0.1 % to 1 %.
  @steps 1_000

  @typedoc "How many durations were from so many nanoseconds up to the next step."
  @type t :: %{non_neg_integer() => pos_integer()}

  @doc "Nothing measured yet."
  @spec new() :: t()
  def new, do: %{}

  @doc "Counts one duration in nanoseconds."
  @spec add(t(), integer()) :: t()
  def add(counts, ns), do: Map.update(counts, floor_ns(max(ns, 0), @step_ns), 1, &(&1 + 1))

  defp floor_ns(ns, step_ns) when ns < @steps * step_ns, do: ns - rem(ns, step_ns)
  defp floor_ns(ns, step_ns), do: floor_ns(ns, 10 * step_ns)

  @doc "The least duration, in microseconds, that the share `q` of all does not exceed."
  @spec quantile_us(t(), float()) :: non_neg_integer() | nil
  def quantile_us(counts, _q) when counts == %{}, do: nil

  def quantile_us(counts, q) do
    rank = ceil(q * Enum.sum(Map.values(counts)))

    counts
    |> Enum.sort()
    |> Enum.reduce_while(0, fn {floor_ns, count}, seen ->
      if seen + count >= rank, do: {:halt, {:found, floor_ns}}, else: {:cont, seen + count}
    end)
    |> then(fn {:found, floor_ns} -> div(floor_ns, 1000) end)
  end
end
