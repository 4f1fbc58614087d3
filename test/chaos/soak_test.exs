defmodule BB.Test.ChaosSoakTest do
  @moduledoc "The judge of `bin/chaos soak` finds what it looks for."

  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Test.Chaos.Soak.Trend

  doctest Trend

  # Garbage: a value that climbs and falls again.
  defp sawtooth(seconds),
    do: for(second <- 0..seconds, do: {second, 1_000 + rem(second * 37, 100)})

  test "garbage that comes and goes is flat, also when the last sample stands high" do
    assert Trend.flat?(sawtooth(600), 20, 0.0)
  end

  test "a slow gain below garbage is not" do
    leaking = for {second, value} <- sawtooth(600), do: {second, value + 0.1 * second}
    refute Trend.flat?(leaking, 20, 0.0)
    assert Trend.flat?(leaking, 70, 0.0)
    assert Trend.flat?(leaking, 0, 0.07)
  end

  test "a single step up is a gain of nothing that goes on, one in the middle of many is" do
    step = for second <- 0..600, do: {second, if(second > 590, do: 7, else: 5)}
    assert Trend.flat?(step, 0.5, 0.0)
    stairs = for second <- 0..600, do: {second, div(second, 100)}
    refute Trend.flat?(stairs, 0.5, 0.0)
  end

  test "what falls is flat" do
    assert Trend.flat?(for(second <- 0..100, do: {second, -second}), 0, 0.0)
  end

  property "the gain of a straight line is what it gained" do
    forall {slope, seconds} <- {integer(0, 1_000), integer(1, 2_000)} do
      samples = for second <- 0..seconds, do: {second, slope * second}
      abs(Trend.gain(samples) - slope * seconds) < 1.0e-6
    end
  end
end
