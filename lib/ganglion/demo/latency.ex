defmodule Ganglion.Demo.Latency do
  @moduledoc """
  A distribution of durations in bounded memory.

  `Ganglion.Demo.Observation` uses it for the latency of detections. It counts durations in steps
  of 10 µs, and from 10 ms on in steps of at most 1 %. It is pure.

      iex> alias Ganglion.Demo.Latency
      iex> latency = Enum.reduce(1..100, Latency.new(), &Latency.add(&2, &1 * 1_000_000))
      iex> {Latency.quantile_us(latency, 0.5), Latency.quantile_us(latency, 0.99)}
      {50_000, 99_000}
      iex> Latency.quantile_us(Latency.new(), 0.5)
      nil
  """

  @step_ns 10_000
  # A decade has nine tenths of these steps, so that a step is 0.1 % to 1 % of the duration.
  @steps 1_000

  @typedoc "The number of durations in each step, by the step's lower bound in nanoseconds."
  @type t :: %{non_neg_integer() => pos_integer()}

  @doc "Returns an empty distribution."
  @spec new() :: t()
  def new, do: %{}

  @doc "Adds a duration in nanoseconds."
  @spec add(t(), integer()) :: t()
  def add(counts, ns), do: Map.update(counts, floor_ns(max(ns, 0), @step_ns), 1, &(&1 + 1))

  defp floor_ns(ns, step_ns) when ns < @steps * step_ns, do: ns - rem(ns, step_ns)
  defp floor_ns(ns, step_ns), do: floor_ns(ns, 10 * step_ns)

  @doc """
  Returns the `q`-quantile in microseconds, or `nil` for an empty distribution.

  It is the least duration that is not exceeded by the share `q` of all durations.
  """
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
