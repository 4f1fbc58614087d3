defmodule BB.Sensor.Mpu6050.StampsTest do
  use ExUnit.Case, async: true

  alias BB.Sensor.Mpu6050.Stamps

  doctest BB.Sensor.Mpu6050.Stamps

  @ms 1_000_000

  # Edges at those milliseconds, each arriving at once, with a clock equal to the kernel's.
  defp edges(stamps \\ Stamps.new(@ms), edges_ms) do
    Enum.reduce(edges_ms, stamps, &Stamps.add_edge(&2, &1 * @ms, &1 * @ms))
  end

  defp take(stamps, count) do
    {:ok, times, stamps} = Stamps.take(stamps, count)
    {Enum.map(times, &(&1 / @ms)), stamps}
  end

  describe "of samples and edges" do
    test "as many belong together in order" do
      assert {[1.0, 2.0, 3.0], stamps} = take(edges([1, 2, 3]), 3)
      assert {[4.0], stamps} = take(edges(stamps, [4]), 1)
      assert {[], _} = take(stamps, 1)
    end

    test "a sample whose edge is still to come waits for it" do
      assert {[1.0, 2.0], stamps} = take(edges([1, 2]), 3)
      assert {[3.0, 4.0], _} = take(edges(stamps, [3, 4]), 2)
    end

    test "a lost edge is detected after a while, and corrected" do
      # The edge of 1 is lost: 1 has the time of 2, 2 that of 3, and so on.
      stamps =
        for ms <- 2..9, reduce: Stamps.new(@ms) do
          stamps ->
            {times, stamps} = take(edges(stamps, [ms]), 2)
            assert times == [ms * 1.0]
            stamps
        end

      assert {[9.000001, 10.0], stamps} = take(edges(stamps, [10]), 2)
      assert {[11.0], _} = take(edges(stamps, [11]), 1)
    end

    test "several lost edges are corrected at once" do
      assert {[1.0, 2.0, 3.0, 4.0], _} = take(edges([3, 4]), 4)
    end

    test "an edge too many does not shift those after it" do
      assert {[2.0, 3.0], stamps} = take(edges([1, 2, 3]), 2)
      assert {[4.0], _} = take(edges(stamps, [4]), 1)
      assert {[], _} = take(edges([1]), 0)
    end

    test "many edges too many are noise" do
      assert Stamps.take(edges(Enum.to_list(1..10)), 1) == :noise
    end
  end

  describe "the kernel's clock" do
    test "is compared by the edge that arrived soonest" do
      stamps =
        Stamps.new(@ms)
        |> Stamps.add_edge(1 * @ms, 501 * @ms + 400_000)
        |> Stamps.add_edge(2 * @ms, 502 * @ms + 20_000)
        |> Stamps.add_edge(3 * @ms, 503 * @ms + 900_000)

      assert {[501.02, 502.02, 503.02], _} = take(stamps, 3)
    end

    test "never gives two samples the same time, or a later sample an earlier time" do
      {[501.4], stamps} =
        Stamps.new(@ms) |> Stamps.add_edge(1 * @ms, 501 * @ms + 400_000) |> take(1)

      {[502.4], stamps} = stamps |> Stamps.add_edge(2 * @ms, 503 * @ms) |> take(1)
      {[time], _} = stamps |> Stamps.add_edge(2 * @ms + 100, 500 * @ms) |> take(1)
      assert time == 502.400001
    end

    test "may drift: a difference of more than two seconds ago no longer counts" do
      drift = fn ms -> ms * @ms + div(ms, 100) * 1000 end

      stamps =
        for ms <- 0..5000//100, reduce: Stamps.new(100 * @ms) do
          stamps ->
            {[_time], stamps} = stamps |> Stamps.add_edge(ms * @ms, drift.(ms)) |> take(1)
            stamps
        end

      {[time], _} = stamps |> Stamps.add_edge(5100 * @ms, drift.(5100)) |> take(1)
      assert_in_delta time, drift.(5100) / @ms, 0.021
    end
  end

  test "without a FIFO the last edge belongs to the sample" do
    assert {3_000_000, stamps} = Stamps.take_last(edges([1, 2, 3]))
    assert {[4.0], _} = take(edges(stamps, [4]), 1)
  end
end
