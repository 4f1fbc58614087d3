defmodule BB.Actuator.MotorProfile do
  @moduledoc """
  The limits of an actuator's motor: those of its joint, converted by its transmission. Pure.

  The driver's `init/1` receives it as an option, and `handle_options/2` again when a parameter in
  the limits or in the transmission changes:

      def init(opts) do
        %BB.Actuator.MotorProfile{motor_lower: lower, motor_upper: upper} = opts[:motor_profile]
        {:ok, %{range: {lower, upper}}}
      end

  The fields are in SI units of the motor: rad and N·m, or m and N. A limit that the joint does
  not have is `nil`.

    * `:motor_lower`, `:motor_upper` - the bounds of the position
    * `:motor_velocity_limit`, `:motor_acceleration_limit`, `:motor_effort_limit` - magnitudes
    * `:motor_initial_position` - the middle between the bounds, 0.0 without both
  """

  alias BB.Transmission

  defstruct [
    :motor_lower,
    :motor_upper,
    :motor_velocity_limit,
    :motor_acceleration_limit,
    :motor_effort_limit,
    motor_initial_position: 0.0
  ]

  @type t :: %__MODULE__{
          motor_lower: float() | nil,
          motor_upper: float() | nil,
          motor_velocity_limit: float() | nil,
          motor_acceleration_limit: float() | nil,
          motor_effort_limit: float() | nil,
          motor_initial_position: float()
        }

  @doc """
  Returns the profile of a motor that moves `joint`, a `BB.Robot.Joint`, by a transmission.

      iex> joint = %{limits: %{lower: -1.0, upper: 0.5, velocity: 2.0}}
      iex> gears = %{reduction: 10.0, offset: 0.0, reversed?: true}
      iex> profile = BB.Actuator.MotorProfile.from_joint(joint, gears)
      iex> {profile.motor_lower, profile.motor_upper, profile.motor_velocity_limit}
      {-5.0, 10.0, 20.0}
      iex> profile.motor_initial_position
      2.5
      iex> BB.Actuator.MotorProfile.from_joint(nil, nil)
      %BB.Actuator.MotorProfile{motor_lower: nil, motor_initial_position: 0.0}
  """
  @spec from_joint(BB.Robot.Joint.t() | BB.Component.joint() | nil, Transmission.t() | nil) :: t()
  def from_joint(%{limits: %{} = limits}, transmission) do
    {lower, upper} = bounds(limits[:lower], limits[:upper], transmission)

    %__MODULE__{
      motor_lower: lower,
      motor_upper: upper,
      motor_velocity_limit: magnitude(limits[:velocity], transmission, :apply_rate),
      motor_acceleration_limit: magnitude(limits[:acceleration], transmission, :apply_rate),
      motor_effort_limit: magnitude(limits[:effort], transmission, :apply_effort),
      motor_initial_position: if(lower && upper, do: (lower + upper) / 2, else: 0.0)
    }
  end

  def from_joint(_joint_without_limits, _transmission), do: %__MODULE__{}

  # A reversed motor has its upper bound where the joint has its lower one.
  defp bounds(lower, upper, transmission) do
    {lower, upper} = {motor_position(lower, transmission), motor_position(upper, transmission)}
    if Transmission.apply_rate(1.0, transmission) < 0, do: {upper, lower}, else: {lower, upper}
  end

  defp motor_position(nil, _transmission), do: nil
  defp motor_position(joint, transmission), do: Transmission.apply_position(joint, transmission)

  defp magnitude(nil, _transmission, _convert), do: nil
  defp magnitude(joint, t, :apply_rate), do: abs(Transmission.apply_rate(joint, t))
  defp magnitude(joint, t, :apply_effort), do: abs(Transmission.apply_effort(joint, t))
end
