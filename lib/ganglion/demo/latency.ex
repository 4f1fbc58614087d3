defmodule Ganglion.Demo.Latency do
  @moduledoc """
  A distribution of durations in bounded memory: counts by steps of 10 µs.

      iex> latency = Enum.reduce(1..100, Ganglion.Demo.Latency.new(), &Ganglion.Demo.Latency.add(&2, &1 * 1_000_000))
      iex> {Ganglion.Demo.Latency.quantile_us(latency, 0.5), Ganglion.Demo.Latency.quantile_us(latency, 0.99)}
      {50_000, 99_000}
      iex> Ganglion.Demo.Latency.quantile_us(Ganglion.Demo.Latency.new(), 0.5)
      nil
  """

  @step_ns 10_000

  @type t :: %{non_neg_integer() => pos_integer()}

  @doc "Nothing measured yet."
  @spec new() :: t()
  def new, do: %{}

  @doc "Counts one duration in nanoseconds."
  @spec add(t(), integer()) :: t()
  def add(counts, ns), do: Map.update(counts, max(div(ns, @step_ns), 0), 1, &(&1 + 1))

  @doc "The least duration, in microseconds, that the share `q` of all does not exceed."
  @spec quantile_us(t(), float()) :: non_neg_integer() | nil
  def quantile_us(counts, _q) when counts == %{}, do: nil

  def quantile_us(counts, q) do
    rank = ceil(q * Enum.sum(Map.values(counts)))

    counts
    |> Enum.sort()
    |> Enum.reduce_while(0, fn {step, count}, seen ->
      if seen + count >= rank, do: {:halt, {:found, step}}, else: {:cont, seen + count}
    end)
    |> then(fn {:found, step} -> div(step * @step_ns, 1000) end)
  end
end
