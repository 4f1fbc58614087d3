defmodule BB.Math.RotationMatrix do
  @moduledoc """
  Rotation matrices as three rows of three numbers, from and to quaternions.
  `BB.Math.Quaternion` and `BB.Math.Transform` use it.

      iex> BB.Math.RotationMatrix.from_quaternion(0.0, 1.0, 0.0, 0.0)
      [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
  """

  @type rows :: [[number()]]

  @doc "Returns the matrix of a unit quaternion."
  @spec from_quaternion(float(), float(), float(), float()) :: [[float()]]
  def from_quaternion(w, x, y, z) do
    [
      [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
      [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
      [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]
    ]
  end

  @doc """
  Returns a multiple of the quaternion of a matrix, as `[w, x, y, z]`.

  The largest of the four elements is computed first (Shepperd's method): the quaternion is most
  precise with it as the divisor.
  """
  @spec to_quaternion(rows()) :: [number()]
  def to_quaternion([[a, b, c], [d, e, f], [g, h, i]]) do
    squares = [{a + e + i, :w}, {a - e - i, :x}, {e - a - i, :y}, {i - a - e, :z}]

    case Enum.max(squares) do
      {s, :w} -> [1 + s, h - f, c - g, d - b]
      {s, :x} -> [h - f, 1 + s, b + d, c + g]
      {s, :y} -> [c - g, b + d, 1 + s, f + h]
      {s, :z} -> [d - b, c + g, f + h, 1 + s]
    end
  end
end
