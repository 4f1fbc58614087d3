defmodule BB.Sensor.QuadratureEncoder.CounterTest do
  use ExUnit.Case, async: true

  alias BB.Sensor.QuadratureEncoder.Counter

  doctest Counter

  @forwards [0b00, 0b01, 0b11, 0b10]
  @ms 1_000_000

  # Goes through values, an edge each `period_ns` from `from_ns` on.
  defp turn(counter, values, from_ns, period_ns) do
    values
    |> Enum.chunk_every(2, 1, :discard)
    |> Enum.with_index(1)
    |> Enum.reduce(counter, fn {[previous, value], n}, counter ->
      Counter.edge(counter, value, previous, from_ns + n * period_ns)
    end)
  end

  defp forwards(edges, from \\ 0),
    do: @forwards |> Stream.cycle() |> Stream.drop(from) |> Enum.take(edges + 1)

  test "a period of both lines is four counts, up when A leads and down when B does" do
    assert turn(Counter.new(), forwards(4), 0, @ms).count == 4
    assert turn(Counter.new(), Enum.reverse(forwards(4)), 0, @ms).count == -4
  end

  test "a trembling edge is no movement" do
    counter = turn(Counter.new(), [0b00, 0b01, 0b00, 0b01, 0b00], 0, @ms)
    assert counter.count == 0
    assert {rate, _} = Counter.rate(counter, 0.02)
    assert_in_delta rate, 0.0, 1000.0
  end

  test "the rate is measured between edges, at any time of reading" do
    counter = turn(Counter.new(), forwards(10), 0, @ms)
    {rate, counter} = Counter.rate(counter, 0.0123)
    assert_in_delta rate, 1000.0, 1.0e-6
    {rate, _} = counter |> turn(forwards(10, 2), 10 * @ms, 2 * @ms) |> Counter.rate(0.0321)
    assert_in_delta rate, 500.0, 1.0e-6
  end

  test "backwards it is negative" do
    {rate, _} = Counter.new() |> turn(Enum.reverse(forwards(8)), 0, @ms) |> Counter.rate(0.02)
    assert_in_delta rate, -1000.0, 1.0e-6
  end

  test "one edge in several readings is a slow movement, not a jump" do
    {_, counter} = Counter.new() |> turn(forwards(4), 0, 50 * @ms) |> Counter.rate(0.02)
    {_, counter} = Counter.rate(counter, 0.02)
    {_, counter} = Counter.rate(counter, 0.02)
    {rate, _} = counter |> Counter.edge(0b01, 0b00, 250 * @ms) |> Counter.rate(0.02)
    assert_in_delta rate, 20.0, 1.0e-6
  end

  test "without edges it is at most the rate of one edge now, and 0 after half a second" do
    {rate, counter} = Counter.new() |> turn(forwards(10), 0, @ms) |> Counter.rate(0.02)
    assert_in_delta rate, 1000.0, 1.0e-6
    {rate, counter} = Counter.rate(counter, 0.02)
    assert_in_delta rate, 50.0, 1.0e-6
    {rate, counter} = Counter.rate(counter, 0.02)
    assert_in_delta rate, 25.0, 1.0e-6
    assert {rate, counter} = Counter.rate(counter, 0.5)
    assert rate == 0.0
    assert {rate, _counter} = Counter.rate(counter, 0.02)
    assert rate == 0.0
  end

  test "after a standstill it is measured between new edges alone" do
    {_, counter} = Counter.new() |> turn(forwards(4), 0, @ms) |> Counter.rate(0.02)
    {_, counter} = Counter.rate(counter, 10.0)
    {rate, _} = counter |> turn(forwards(4), 10_000 * @ms, @ms) |> Counter.rate(0.02)
    assert_in_delta rate, 1000.0, 1.0e-6
  end

  test "a hundred edges of one line in a row are no wheel" do
    trembling = [0b00, 0b01] |> Stream.cycle() |> Enum.take(100)
    counter = turn(Counter.new(), trembling, 0, @ms)
    assert Counter.fault(counter) == nil
    assert counter |> Counter.edge(0b00, 0b01, 0) |> Counter.fault() == {:one_line, :a}
    assert counter |> Counter.edge(0b11, 0b01, 0) |> Counter.fault() == nil
  end

  test "an edge without a change means a lost edge, and more than one in ten are a fault" do
    counter = turn(Counter.new(), forwards(40), 0, @ms)

    lost = fn counter, n ->
      Enum.reduce(1..n, counter, fn _, c -> Counter.edge(c, 0, 0, 0) end)
    end

    assert counter |> lost.(4) |> Counter.fault() == nil
    assert counter |> lost.(5) |> Counter.fault() == :missed
    assert Counter.new() |> lost.(2) |> Counter.fault() == nil
    assert lost.(counter, 5).count == 40
  end
end
