defmodule BB.Math.Transform do
  @moduledoc """
  A rigid transform in space: a rotation, then a translation, as a 4 × 4 matrix with its sixteen
  floats row by row in `m`.

  Use it for the pose of a body's frame in its parent's: `apply_point/2` transforms a point from
  the body's coordinates to the parent's, and `compose(parent, child)` chains poses.

      iex> alias BB.Math.{Quaternion, Transform, Vec3}
      iex> left = Quaternion.from_axis_angle(Vec3.unit_z(), :math.pi() / 2)
      iex> camera = Transform.new(left, Vec3.new(1, 0, 0))
      iex> point = Transform.apply_point(camera, Vec3.new(2, 0, 0))
      iex> Vec3.distance(point, Vec3.new(1, 2, 0)) < 1.0e-15
      true
  """

  alias BB.Math.{Quaternion, Vec3}

  @enforce_keys [:m]
  defstruct [:m]

  @typedoc "A transform. The last row of its matrix is 0, 0, 0, 1."
  @type t :: %__MODULE__{m: tuple()}

  @doc "Creates the transform that rotates, then translates."
  @spec new(Quaternion.t(), Vec3.t()) :: t()
  def new(%Quaternion{w: w, x: x, y: y, z: z}, %Vec3{} = t) do
    %__MODULE__{
      m:
        {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), t.x,
         2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), t.y,
         2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), t.z, 0.0, 0.0, 0.0,
         1.0}
    }
  end

  @doc """
  Creates a transform from a list of sixteen numbers, row by row.

  Raises `ArgumentError` for a list of another length, or if the last row is not 0, 0, 0, 1. It
  does not check that the rest is a rotation.
  """
  @spec from_list([number()]) :: t()
  def from_list(elements) when is_list(elements) do
    floats = Enum.map(elements, &:erlang.float/1)

    if length(floats) == 16 and Enum.drop(floats, 12) == [0.0, 0.0, 0.0, 1.0] do
      %__MODULE__{m: List.to_tuple(floats)}
    else
      raise ArgumentError,
            "expected a list of 16 numbers with 0, 0, 0, 1 as the last row, got: " <>
              "#{inspect(elements)}"
    end
  end

  @doc "Returns the transform that changes nothing."
  @spec identity() :: t()
  def identity, do: new(Quaternion.identity(), Vec3.zero())

  @doc "Returns a rotation about the origin."
  @spec from_rotation(Quaternion.t()) :: t()
  def from_rotation(%Quaternion{} = rotation), do: new(rotation, Vec3.zero())

  @doc "Returns a translation."
  @spec from_translation(Vec3.t()) :: t()
  def from_translation(%Vec3{} = translation), do: new(Quaternion.identity(), translation)

  @doc "Returns the translation of the transform."
  @spec translation(t()) :: Vec3.t()
  def translation(%__MODULE__{m: m}), do: %Vec3{x: elem(m, 3), y: elem(m, 7), z: elem(m, 11)}

  @doc "Returns the rotation of the transform."
  @spec rotation(t()) :: Quaternion.t()
  def rotation(%__MODULE__{m: {a, b, c, _, d, e, f, _, g, h, i, _, _, _, _, _}}) do
    # The division is most precise by the largest of the four squares.
    squares = [{a + e + i, :w}, {a - e - i, :x}, {e - a - i, :y}, {i - a - e, :z}]

    case Enum.max(squares) do
      {s, :w} -> Quaternion.new(1 + s, h - f, c - g, d - b)
      {s, :x} -> Quaternion.new(h - f, 1 + s, b + d, c + g)
      {s, :y} -> Quaternion.new(c - g, b + d, 1 + s, f + h)
      {s, :z} -> Quaternion.new(d - b, c + g, f + h, 1 + s)
    end
  end

  @doc "Returns the element in `row` and `column`, each from 0 to 3."
  @spec at(t(), 0..3, 0..3) :: float()
  def at(%__MODULE__{m: m}, row, column) when row in 0..3 and column in 0..3,
    do: elem(m, 4 * row + column)

  @doc "Returns the sixteen elements, row by row."
  @spec to_list(t()) :: [float()]
  def to_list(%__MODULE__{m: m}), do: Tuple.to_list(m)

  @doc "Returns the transform `b` followed by `a`, the product of their matrices."
  @spec compose(t(), t()) :: t()
  def compose(%__MODULE__{m: a}, %__MODULE__{m: b}) do
    {a11, a12, a13, a14, a21, a22, a23, a24, a31, a32, a33, a34, _, _, _, _} = a
    {b11, b12, b13, b14, b21, b22, b23, b24, b31, b32, b33, b34, _, _, _, _} = b

    %__MODULE__{
      m:
        {a11 * b11 + a12 * b21 + a13 * b31, a11 * b12 + a12 * b22 + a13 * b32,
         a11 * b13 + a12 * b23 + a13 * b33, a11 * b14 + a12 * b24 + a13 * b34 + a14,
         a21 * b11 + a22 * b21 + a23 * b31, a21 * b12 + a22 * b22 + a23 * b32,
         a21 * b13 + a22 * b23 + a23 * b33, a21 * b14 + a22 * b24 + a23 * b34 + a24,
         a31 * b11 + a32 * b21 + a33 * b31, a31 * b12 + a32 * b22 + a33 * b32,
         a31 * b13 + a32 * b23 + a33 * b33, a31 * b14 + a32 * b24 + a33 * b34 + a34, 0.0, 0.0,
         0.0, 1.0}
    }
  end

  @doc "Returns the inverse transform."
  @spec inverse(t()) :: t()
  def inverse(%__MODULE__{m: {a, b, c, _, d, e, f, _, g, h, i, _, _, _, _, _}} = transform) do
    %Vec3{x: x, y: y, z: z} = translation(transform)

    %__MODULE__{
      m:
        {a, d, g, -(a * x + d * y + g * z), b, e, h, -(b * x + e * y + h * z), c, f, i,
         -(c * x + f * y + i * z), 0.0, 0.0, 0.0, 1.0}
    }
  end

  @doc "Transforms a point."
  @spec apply_point(t(), Vec3.t()) :: Vec3.t()
  def apply_point(%__MODULE__{} = transform, %Vec3{} = point),
    do: Vec3.add(apply_vector(transform, point), translation(transform))

  @doc "Rotates a direction. The translation does not apply to it."
  @spec apply_vector(t(), Vec3.t()) :: Vec3.t()
  def apply_vector(%__MODULE__{m: {a, b, c, _, d, e, f, _, g, h, i, _, _, _, _, _}}, %Vec3{
        x: x,
        y: y,
        z: z
      }) do
    %Vec3{
      x: a * x + b * y + c * z,
      y: d * x + e * y + f * z,
      z: g * x + h * y + i * z
    }
  end
end
