defmodule Ganglion.Demo.LatencyTest do
  use ExUnit.Case, async: true

  alias Ganglion.Demo.Latency

  doctest Ganglion.Demo.Latency

  defp of(durations_us),
    do: Enum.reduce(durations_us, Latency.new(), &Latency.add(&2, &1 * 1000))

  test "a quantile is that of the durations to 10 µs, in whatever order they came" do
    durations = Enum.shuffle(1..1000) |> Enum.map(&(&1 * 10))
    assert Latency.quantile_us(of(durations), 0.5) == 5_000
    assert Latency.quantile_us(of(durations), 1.0) == 10_000
  end

  test "the least quantile is the least duration" do
    assert Latency.quantile_us(of([30, 20, 70]), 0.0) == 20
  end

  test "a duration below zero, of a clock that is not quite the other, counts as none" do
    assert Latency.quantile_us(of([-5]), 0.5) == 0
  end
end
