defmodule BB.Sim.Motion do
  @moduledoc """
  Plans the motion of a simulated actuator, and calculates its position in between. Pure.

      iex> profile = %BB.Actuator.MotorProfile{
      ...>   motor_upper: 3.0,
      ...>   motor_velocity_limit: 1.0,
      ...>   motor_acceleration_limit: 1.0
      ...> }
      iex> motion = BB.Sim.Motion.plan(0.0, 5.0, profile, 0)
      iex> {motion.to, motion.duration_ms, motion.peak_velocity}
      {3.0, 4000, 1.0}
      iex> BB.Sim.Motion.position(motion, 2_000)
      1.5

  With limits of velocity and acceleration the velocity is a trapezoid, or a triangle where the
  way is too short for the full velocity. Without a limit of the acceleration it is constant.
  """

  alias BB.Actuator.MotorProfile
  alias BB.Sensor.OpenLoopPositionEstimator.Motion, as: Course

  @enforce_keys [:from, :to, :begin_ms, :duration_ms]
  defstruct [:from, :to, :begin_ms, :duration_ms, :acceleration, :peak_velocity]

  @type t :: %__MODULE__{
          from: float(),
          to: float(),
          begin_ms: integer(),
          duration_ms: non_neg_integer(),
          acceleration: float() | nil,
          peak_velocity: float() | nil
        }

  @doc "Returns the motion of an actuator that stands at a position."
  @spec at(float(), integer()) :: t()
  def at(position, now_ms),
    do: %__MODULE__{from: position, to: position, begin_ms: now_ms, duration_ms: 0}

  @doc "Returns the motion to a position, or to the bound of the motor before it."
  @spec plan(float(), float(), MotorProfile.t(), integer()) :: t()
  def plan(from, to, %MotorProfile{} = profile, now_ms) do
    to = to |> at_least(profile.motor_lower) |> at_most(profile.motor_upper)
    motion = %{at(from, now_ms) | to: to}
    course(motion, abs(to - from), profile.motor_velocity_limit, profile.motor_acceleration_limit)
  end

  defp at_least(position, bound), do: if(bound && position < bound, do: bound, else: position)
  defp at_most(position, bound), do: if(bound && position > bound, do: bound, else: position)

  defp course(motion, distance, velocity, _acceleration)
       when distance == 0 or velocity in [nil, 0.0],
       do: motion

  defp course(motion, distance, velocity, acceleration) when acceleration in [nil, 0.0],
    do: %{motion | duration_ms: ms(distance / velocity)}

  defp course(motion, distance, velocity, acceleration) do
    peak = min(velocity, :math.sqrt(acceleration * distance))

    %{
      motion
      | duration_ms: ms(distance / peak + peak / acceleration),
        acceleration: acceleration,
        peak_velocity: peak
    }
  end

  defp ms(seconds), do: round(seconds * 1_000)

  @doc "Returns the position at a moment."
  @spec position(t(), integer()) :: float()
  def position(%__MODULE__{} = motion, now_ms) do
    %{from: from, to: to, duration_ms: duration_ms, acceleration: a, peak_velocity: v} = motion
    elapsed_ms = now_ms - motion.begin_ms

    cond do
      elapsed_ms >= duration_ms -> to
      a != nil -> Course.trapezoid(elapsed_ms, from, to, duration_ms, a, v)
      true -> Course.ease(:linear, elapsed_ms, from, to - from, duration_ms)
    end
  end
end
