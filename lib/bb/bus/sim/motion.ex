defmodule BB.Bus.Sim.Motion do
  @moduledoc """
  A built-in motion for simulated inertial sensors: a robot that rocks and turns slowly.

  Simulated chips use it as the default source. It is a function of time alone, so a test can
  compute the reading that a sensor should have.

      iex> %{angular_velocity: {x, _y, _z}} = BB.Bus.Sim.Motion.at(0)
      iex> Float.round(x, 3)
      0.394

  The attitude is roll, pitch and yaw (applied as yaw, pitch, roll), each a sine of a few seconds.
  The angular velocity is the attitude's true rate in the body's frame. The acceleration is the
  reaction to gravity there, z up, at the point about which the body turns.
  """

  @typedoc "A vector in the sensor's frame."
  @type vector :: {x :: float(), y :: float(), z :: float()}

  @typedoc """
  The quantities at one time: specific force in m/s² (at rest +9.81 on the axis that points up),
  rotation in rad/s, and chip temperature in °C.
  """
  @type sample :: %{acceleration: vector(), angular_velocity: vector(), temperature: float()}

  @standard_gravity 9.80665

  # {amplitude in rad, frequency in Hz, phase in rad}
  @roll {0.35, 0.20, 0.0}
  @pitch {0.25, 0.13, 1.0}
  @yaw {0.50, 0.07, 0.0}

  @doc "Returns standard gravity in m/s²."
  @spec standard_gravity() :: float()
  def standard_gravity, do: @standard_gravity

  @doc "Returns the quantities at `seconds`."
  @spec at(number()) :: sample()
  def at(seconds) do
    {roll, roll_rate} = swing(@roll, seconds)
    {pitch, pitch_rate} = swing(@pitch, seconds)
    {_yaw, yaw_rate} = swing(@yaw, seconds)

    %{
      acceleration: scale(up(roll, pitch), @standard_gravity),
      angular_velocity: body_rate({roll, pitch}, {roll_rate, pitch_rate, yaw_rate}),
      temperature: 30.0 + 2.0 * :math.sin(seconds / 60)
    }
  end

  defp swing({amplitude, frequency_hz, phase}, seconds) do
    omega = 2 * :math.pi() * frequency_hz
    angle = omega * seconds + phase
    {amplitude * :math.sin(angle), amplitude * omega * :math.cos(angle)}
  end

  defp up(roll, pitch) do
    {-:math.sin(pitch), :math.cos(pitch) * :math.sin(roll), :math.cos(pitch) * :math.cos(roll)}
  end

  defp body_rate({roll, pitch}, {roll_rate, pitch_rate, yaw_rate}) do
    {up_x, up_y, up_z} = up(roll, pitch)

    {
      roll_rate + yaw_rate * up_x,
      pitch_rate * :math.cos(roll) + yaw_rate * up_y,
      -pitch_rate * :math.sin(roll) + yaw_rate * up_z
    }
  end

  defp scale({x, y, z}, factor), do: {x * factor, y * factor, z * factor}
end
