defmodule BB.Component.BackoffTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Component.Backoff

  doctest Backoff

  defp with_random(value), do: Backoff.new(random: fn -> value end)

  defp delays(backoff, cause, count, init_ms \\ 0) do
    {delays, _backoff} =
      Enum.map_reduce(1..count, backoff, fn _, backoff ->
        Backoff.next(backoff, cause, init_ms)
      end)

    delays
  end

  test "a crash is retried after 100 ms, then after twice as long, up to 5 s for a slow start" do
    assert delays(with_random(1.0), :crash, 8, 10_000) ==
             [100, 200, 400, 800, 1600, 3200, 5000, 5000]

    assert delays(with_random(1.0), :crash, 6, 300) == [100, 200, 400, 800, 1200, 1200]
  end

  test "a component that starts at once is always retried within 750 ms" do
    assert delays(with_random(1.0), :crash, 6) == [100, 200, 400, 750, 750, 750]
    assert delays(with_random(1.0), :crash, 1_000) |> Enum.max() == 750
  end

  test "one slow start among quick ones, on a machine that stood still, makes no delay longer" do
    quick = Enum.reduce(1..6, with_random(1.0), &elem(Backoff.next(&2, :crash, &1), 1))
    assert {750, backoff} = Backoff.next(quick, :crash, 2_000)
    assert {750, backoff} = Backoff.next(backoff, :crash, 1)
    assert {750, backoff} = Backoff.next(backoff, :crash, 2_000)
    assert {5_000, _} = Backoff.next(backoff, :crash, 2_000)
  end

  test "an absent device is always retried within 750 ms" do
    assert delays(with_random(1.0), :absent, 6) == [100, 200, 400, 750, 750, 750]
  end

  test "jitter takes at most half of a delay away" do
    assert delays(with_random(0.0), :crash, 3) == [50, 100, 200]
    assert delays(with_random(0.5), :crash, 3) == [75, 150, 300]
  end

  test "absences do not lengthen the delay after a crash" do
    {_, backoff} = Backoff.next(with_random(1.0), :absent)
    {_, backoff} = Backoff.next(backoff, :absent)
    assert {100, _} = Backoff.next(backoff, :crash)
  end

  test "a run shorter than a second is not stable" do
    {_, backoff} = Backoff.next(with_random(1.0), :crash)
    assert {200, _} = backoff |> Backoff.ran(999) |> Backoff.next(:crash)
    assert {100, _} = backoff |> Backoff.ran(1_000) |> Backoff.next(:crash)
  end

  test "a run shorter than four times the delay before it is not stable" do
    backoff =
      Enum.reduce(1..4, with_random(1.0), fn _, backoff ->
        elem(Backoff.next(backoff, :crash, 1_000), 1)
      end)

    assert {1600, _} = backoff |> Backoff.ran(3_199) |> Backoff.next(:crash, 1_000)
    assert {100, _} = backoff |> Backoff.ran(3_200) |> Backoff.next(:crash, 1_000)
  end

  property "every delay is between half of the longest and the longest, which doubles up to the cap",
    numtests: 300 do
    event = oneof([:absent, {:crash, integer(0, 3_000)}, {:ran, integer(0, 30_000)}])

    forall events <- list(event) do
      Enum.reduce_while(events, {true, Backoff.new()}, fn
        {:ran, ms}, {true, backoff} ->
          {:cont, {true, Backoff.ran(backoff, ms)}}

        failure, {true, backoff} ->
          {cause, init_ms} = with :absent <- failure, do: {:absent, 0}
          quicker_ms = min(init_ms, backoff.init_ms)
          cap = if cause == :absent, do: 750, else: min(max(4 * quicker_ms, 750), 5_000)
          longest = min(cap, 100 * 2 ** min(backoff.failures[cause], 10))
          {delay, next} = Backoff.next(backoff, cause, init_ms)
          good? = delay >= div(longest, 2) and delay <= longest
          {if(good?, do: :cont, else: :halt), {good?, next}}
      end)
      |> elem(0)
    end
  end

  property "no number of failures in a row makes a delay longer than the cap", numtests: 50 do
    forall count <- integer(1, 2_000) do
      Enum.max(delays(Backoff.new(), :crash, count, 2_000)) <= 5_000 and
        Enum.max(delays(Backoff.new(), :absent, count)) <= 750
    end
  end
end
