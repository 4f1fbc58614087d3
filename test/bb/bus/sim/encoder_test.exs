defmodule BB.Bus.Sim.EncoderTest do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim.Encoder

  # The model is pure: the test plays the chip and the clock.

  defp turning(velocity) do
    {:ok, encoder, [_a, _b | later]} = Encoder.init([pulses: 100, velocity: velocity], 0)
    {encoder, later}
  end

  # The levels of A and B after each of so many edges, and the times of these.
  defp edges({encoder, later}, count) do
    for _ <- 1..count, reduce: {[], [], encoder, later} do
      {levels, times, encoder, [{:at, time_ns, event}]} ->
        {encoder, [{:drive, :a, a}, {:drive, :b, b} | later]} =
          Encoder.due(event, time_ns, encoder)

        {levels ++ [{a, b}], times ++ [time_ns], encoder, later}
    end
  end

  test "forwards A leads, backwards B" do
    assert {[{1, 0}, {1, 1}, {0, 1}, {0, 0}], _, _, _} = edges(turning(1.0), 4)
    assert {[{0, 1}, {1, 1}, {1, 0}, {0, 0}], _, _, _} = edges(turning(-1.0), 4)
  end

  test "a turn of 100 pulses is 400 edges in its time, evenly" do
    {_, times, _, _} = edges(turning(2 * :math.pi()), 400)
    assert hd(times) == 1_250_000
    assert List.last(times) == 998_750_000
    gaps = Enum.zip_with(tl(times), times, &-/2)
    assert Enum.uniq(gaps) == [2_500_000]
  end

  test "turned round between two edges, it comes back over the same one" do
    {_, [time_ns], encoder, _} = edges(turning(2 * :math.pi()), 1)

    {encoder, [:cancel | later]} =
      Encoder.order({:velocity, -2 * :math.pi()}, time_ns + 1000, encoder)

    assert {[{0, 0}], [back_ns], _, _} = edges({encoder, later}, 1)
    assert_in_delta back_ns, time_ns + 2000, 1
  end

  test "wrong options raise with the expected ones" do
    assert_raise ArgumentError, ~r/expected pulses:/, fn -> Encoder.init([], 0) end
    assert_raise ArgumentError, fn -> Encoder.init([pulses: 1, speed: 2], 0) end
    assert Encoder.order(:stop, 0, elem(turning(0.0), 0)) == :error
  end
end
