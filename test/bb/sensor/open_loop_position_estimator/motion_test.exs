defmodule BB.Sensor.OpenLoopPositionEstimator.MotionTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Sensor.OpenLoopPositionEstimator.Motion

  doctest Motion

  test "has the 22 easing functions" do
    assert length(Motion.easings()) == 22
    assert length(Enum.uniq(Motion.easings())) == 22

    for name <- [:linear, :ease_in_sine, :ease_in_out_circular, :ease_out_quintic],
        do: assert(name in Motion.easings())
  end

  # Values of Penner's functions at a quarter and at three quarters of a motion from 0 to 1.
  @values [
    linear: {0.25, 0.75},
    ease_in_sine: {0.0761204675, 0.6173165676},
    ease_out_sine: {0.3826834324, 0.9238795325},
    ease_in_out_sine: {0.1464466094, 0.8535533906},
    ease_in_quad: {0.0625, 0.5625},
    ease_out_quad: {0.4375, 0.9375},
    ease_in_out_quad: {0.125, 0.875},
    ease_in_cubic: {0.015625, 0.421875},
    ease_out_cubic: {0.578125, 0.984375},
    ease_in_out_cubic: {0.0625, 0.9375},
    ease_in_quartic: {0.00390625, 0.31640625},
    ease_out_quartic: {0.68359375, 0.99609375},
    ease_in_out_quartic: {0.03125, 0.96875},
    ease_in_quintic: {0.0009765625, 0.2373046875},
    ease_out_quintic: {0.7626953125, 0.9990234375},
    ease_in_out_quintic: {0.015625, 0.984375},
    ease_in_expo: {0.0055242717, 0.1767766953},
    ease_out_expo: {0.8232233047, 0.9944757283},
    ease_in_out_expo: {0.015625, 0.984375},
    ease_in_circular: {0.0317541634, 0.3385621722},
    ease_out_circular: {0.6614378278, 0.9682458366},
    ease_in_out_circular: {0.0669872981, 0.9330127019}
  ]

  for {easing, {quarter, three_quarters}} <- @values do
    test "#{easing} has the values of Penner's function" do
      assert_in_delta Motion.ease(unquote(easing), 25, 0.0, 1.0, 100), unquote(quarter), 1.0e-9

      assert_in_delta Motion.ease(unquote(easing), 75, 0.0, 1.0, 100),
                      unquote(three_quarters),
                      1.0e-9
    end
  end

  property "an easing begins at the start, ends at the target and never turns back" do
    forall {easing, start, change, duration, first, second} <-
             {oneof(Motion.easings()), float(-10.0, 10.0), float(-10.0, 10.0), integer(1, 10_000),
              integer(-10, 10_010), integer(-10, 10_010)} do
      [first, second] = Enum.sort([first, second])
      at = &Motion.ease(easing, &1, start, change, duration)
      assert at.(0) == start
      assert at.(duration) == start + change
      assert at.(duration + 1) == start + change
      assert_forward(at.(first), at.(second), change)
      true
    end
  end

  property "a trapezoid begins at the start, ends at the target, and never turns back or jumps" do
    forall {start, distance, duration, acceleration, velocity, first, second} <-
             {float(-10.0, 10.0), float(-10.0, 10.0), integer(2, 10_000), float(0.01, 50.0),
              float(0.01, 50.0), integer(-10, 10_010), integer(-10, 10_010)} do
      [first, second] = Enum.sort([first, second])
      target = start + distance
      at = &Motion.trapezoid(&1, start, target, duration, acceleration, velocity)
      assert at.(duration) == target
      assert at.(duration + 5) == target
      if distance != 0.0, do: assert(at.(0) == start)
      assert_forward(at.(first), at.(second), distance)
      assert_in_delta at.(duration / 2), start + distance / 2, 1.0e-6 + abs(distance)
      true
    end
  end

  property "a trapezoid whose numbers agree keeps acceleration and velocity" do
    forall {start, sign, acceleration, ramp_ms, cruise_ms, part} <-
             {float(-10.0, 10.0), oneof([-1.0, 1.0]), float(0.1, 20.0), integer(1, 5_000),
              integer(0, 5_000), float(0.0, 1.0)} do
      velocity = acceleration * ramp_ms / 1_000
      duration_ms = 2 * ramp_ms + cruise_ms
      distance = velocity * (ramp_ms + cruise_ms) / 1_000
      target = start + sign * distance
      elapsed_ms = part * duration_ms

      assert_in_delta Motion.trapezoid(
                        elapsed_ms,
                        start,
                        target,
                        duration_ms,
                        acceleration,
                        velocity
                      ),
                      start +
                        sign * covered(elapsed_ms, ramp_ms, duration_ms, acceleration, velocity),
                      1.0e-6

      true
    end
  end

  # By the laws of motion, from the phases of the velocity.
  defp covered(elapsed_ms, ramp_ms, duration_ms, a, v) do
    {t, r, d} = {elapsed_ms / 1_000, ramp_ms / 1_000, duration_ms / 1_000}

    cond do
      t <= r -> a * t * t / 2
      t <= d - r -> a * r * r / 2 + v * (t - r)
      true -> a * r * r / 2 + v * (d - 2 * r) + v * (t - d + r) - a * (t - d + r) ** 2 / 2
    end
  end

  test "a trapezoid without acceleration, velocity or distance is at its target" do
    assert Motion.trapezoid(1, 0.0, 2.0, 10, 0.0, 1.0) == 2.0
    assert Motion.trapezoid(1, 0.0, 2.0, 10, 1.0, 0.0) == 2.0
    assert Motion.trapezoid(1, 2.0, 2.0, 10, 1.0, 1.0) == 2.0
  end

  defp assert_forward(first, second, change) when change >= 0,
    do: assert(second - first >= -1.0e-9)

  defp assert_forward(first, second, _change), do: assert(first - second >= -1.0e-9)
end
