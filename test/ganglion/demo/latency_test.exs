defmodule Ganglion.Demo.LatencyTest do
  use ExUnit.Case, async: true

  alias Ganglion.Demo.Latency

  doctest Ganglion.Demo.Latency

  defp of(durations_us),
    do: Enum.reduce(durations_us, Latency.new(), &Latency.add(&2, &1 * 1000))

  test "a quantile has a precision of 10 µs, in any order of durations" do
    durations = Enum.shuffle(1..1000) |> Enum.map(&(&1 * 10))
    assert Latency.quantile_us(of(durations), 0.5) == 5_000
    assert Latency.quantile_us(of(durations), 1.0) == 10_000
  end

  test "the 0-quantile is the least duration" do
    assert Latency.quantile_us(of([30, 20, 70]), 0.0) == 20
  end

  test "a negative duration, from clocks that differ, counts as zero" do
    assert Latency.quantile_us(of([-5]), 0.5) == 0
  end

  test "has a precision of one percent in bounded memory, for any range of durations" do
    # From 1 µs to two hours.
    durations = for n <- 0..60_000, do: round(:math.exp(n / 60_000 * :math.log(7.2e9)))
    latency = of(durations)
    assert map_size(latency) < 10_000

    for q <- [0.1, 0.5, 0.9, 0.99, 1.0] do
      exact = Enum.at(durations, ceil(q * length(durations)) - 1)
      assert_in_delta Latency.quantile_us(latency, q), exact, max(10, exact / 100)
    end
  end
end
