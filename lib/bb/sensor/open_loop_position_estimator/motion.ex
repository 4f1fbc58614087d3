defmodule BB.Sensor.OpenLoopPositionEstimator.Motion do
  @moduledoc """
  Calculates the position of a joint in the course of a motion. Pure.

  `BB.Sensor.OpenLoopPositionEstimator` uses it.

      iex> alias BB.Sensor.OpenLoopPositionEstimator.Motion
      iex> Motion.ease(:linear, 25, 0.0, 4.0, 100)
      1.0
      iex> Motion.ease(:ease_in_quad, 50, 0.0, 4.0, 100)
      1.0

  A motion with a known acceleration and peak velocity has the velocity of a trapezoid: it
  accelerates, moves with the peak velocity, and decelerates. The course of any other motion is an
  easing function of Robert Penner.
  """

  @powers [quad: 2, cubic: 3, quartic: 4, quintic: 5]
  @families [:sine, :expo, :circular] ++ Keyword.keys(@powers)

  @easings [
    :linear
    | for(
        family <- @families,
        way <- ~w(ease_in ease_out ease_in_out),
        do: :"#{way}_#{family}"
      )
  ]

  @type easing :: atom()

  @doc "Returns the names of the easing functions, 22 of them."
  @spec easings() :: [easing(), ...]
  def easings, do: @easings

  @doc """
  Returns the position after `elapsed` of `duration`, of a motion that begins at `start` and
  changes by `change`.

  Before the beginning it is the start, after the end the target.
  """
  @spec ease(easing(), number(), float(), float(), number()) :: float()
  def ease(_easing, elapsed, start, _change, _duration) when elapsed <= 0, do: start
  def ease(_easing, elapsed, start, change, duration) when elapsed >= duration, do: start + change

  def ease(easing, elapsed, start, change, duration),
    do: start + change * progress(easing, elapsed / duration)

  defp progress(:linear, u), do: u

  for family <- @families do
    defp progress(unquote(:"ease_in_#{family}"), u), do: rise(unquote(family), u)
    defp progress(unquote(:"ease_out_#{family}"), u), do: 1.0 - rise(unquote(family), 1.0 - u)

    defp progress(unquote(:"ease_in_out_#{family}"), u) when u < 0.5,
      do: rise(unquote(family), 2.0 * u) / 2.0

    defp progress(unquote(:"ease_in_out_#{family}"), u),
      do: 1.0 - rise(unquote(family), 2.0 - 2.0 * u) / 2.0
  end

  # The slow beginning of each family, from 0 to 1.
  defp rise(:sine, u), do: 1.0 - :math.cos(u * :math.pi() / 2.0)
  defp rise(:expo, u) when u <= 0.0, do: 0.0
  defp rise(:expo, u), do: :math.pow(2.0, 10.0 * (u - 1.0))
  defp rise(:circular, u), do: 1.0 - :math.sqrt(max(1.0 - u * u, 0.0))

  for {family, power} <- @powers,
      do: defp(rise(unquote(family), u), do: :math.pow(u, unquote(power)))

  @doc """
  Returns the position of a motion with the velocity of a trapezoid, after `elapsed_ms` of
  `duration_ms`.

  `acceleration` and `peak_velocity` are magnitudes. It is the target when one of them or the
  distance is 0.

      iex> alias BB.Sensor.OpenLoopPositionEstimator.Motion
      iex> for t <- [0, 500, 1_000, 2_000, 3_000, 3_500, 4_000],
      ...>   do: Motion.trapezoid(t, 0.0, 3.0, 4_000, 1.0, 1.0)
      [0.0, 0.125, 0.5, 1.5, 2.5, 2.875, 3.0]
  """
  @spec trapezoid(number(), float(), float(), number(), float(), float()) :: float()
  def trapezoid(elapsed_ms, start, target, duration_ms, acceleration, peak_velocity) do
    distance = abs(target - start)

    cond do
      acceleration == 0 or peak_velocity == 0 or distance == 0 ->
        target

      elapsed_ms <= 0 ->
        start

      elapsed_ms >= duration_ms ->
        target

      true ->
        start +
          sign(target - start) *
            way(
              elapsed_ms,
              distance,
              duration_ms,
              acceleration,
              ramp_ms(acceleration, peak_velocity)
            )
    end
  end

  defp ramp_ms(acceleration, peak_velocity), do: round(peak_velocity / acceleration * 1_000)

  # The second half mirrors the first.
  defp way(elapsed_ms, distance, duration_ms, acceleration, ramp_ms) do
    if elapsed_ms * 2 <= duration_ms,
      do: half(elapsed_ms, distance, duration_ms, acceleration, ramp_ms),
      else:
        distance - half(duration_ms - elapsed_ms, distance, duration_ms, acceleration, ramp_ms)
  end

  # Up to the middle of the distance, also if acceleration, velocity and duration do not agree.
  defp half(elapsed_ms, distance, duration_ms, acceleration, ramp_ms) do
    middle_ms = duration_ms / 2
    ramped = min(ramp(acceleration, min(ramp_ms, middle_ms)), distance / 2)

    if elapsed_ms <= ramp_ms,
      do: min(ramp(acceleration, elapsed_ms), ramped),
      else: ramped + (distance / 2 - ramped) * (elapsed_ms - ramp_ms) / (middle_ms - ramp_ms)
  end

  defp ramp(acceleration, ms), do: acceleration * ms * ms / 2.0e6

  defp sign(number) when number < 0, do: -1.0
  defp sign(_number), do: 1.0
end
