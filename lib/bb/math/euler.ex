defmodule BB.Math.Euler do
  @moduledoc """
  Roll, pitch and yaw of a rotation matrix. `BB.Math.Quaternion.to_euler/2` uses it.

      iex> BB.Math.Euler.from_rows([[1, 0, 0], [0, 1, 0], [0, 0, 1]], :xyz)
      {0.0, 0.0, 0.0}
  """

  @typedoc "The order of the three rotations, see `BB.Math.Quaternion.from_euler/4`."
  @type order :: :xyz | :zyx | atom()

  # From this sine of the pitch on, roll and yaw rotate about the same axis.
  @locked 0.99999

  @doc """
  Returns `{roll, pitch, yaw}` of a matrix, given as three rows of three numbers.

  An order other than `:zyx` is `:xyz`.
  """
  @spec from_rows([[number()]], order()) :: {float(), float(), float()}
  def from_rows([[_, m01, _], [_, m11, _], [m20, _, _]], :zyx) when m20 <= -@locked,
    do: {0.0, :math.pi() / 2, :math.atan2(-m01, m11)}

  def from_rows([[_, m01, _], [_, m11, _], [m20, _, _]], :zyx) when m20 >= @locked,
    do: {0.0, -:math.pi() / 2, :math.atan2(-m01, m11)}

  def from_rows([[m00, _, _], [m10, _, _], [m20, m21, m22]], :zyx),
    do: {:math.atan2(m21, m22), :math.asin(-m20), :math.atan2(m10, m00)}

  def from_rows([[_, _, m02], [m10, m11, _], _], _xyz) when m02 >= @locked,
    do: {0.0, :math.pi() / 2, :math.atan2(m10, m11)}

  def from_rows([[_, _, m02], [m10, m11, _], _], _xyz) when m02 <= -@locked,
    do: {0.0, -:math.pi() / 2, :math.atan2(m10, m11)}

  def from_rows([[m00, m01, m02], [_, _, m12], [_, _, m22]], _xyz),
    do: {:math.atan2(-m12, m22), :math.asin(m02), :math.atan2(-m01, m00)}
end
