defmodule BB.Math.Transform do
  @moduledoc """
  A rigid transform in space: a rotation, then a translation, as a 4 × 4 matrix with its sixteen
  floats row by row in `m`.

  Use it for the pose of a body's frame in its parent's: `apply_to_point/2` transforms a point
  from the body's coordinates to the parent's, and `compose(parent, child)` chains poses.

      iex> alias BB.Math.{Quaternion, Transform, Vec3}
      iex> left = Quaternion.from_axis_angle(Vec3.unit_z(), :math.pi() / 2)
      iex> camera = Transform.from_position_quaternion(Vec3.new(1, 0, 0), left)
      iex> point = Transform.apply_to_point(camera, Vec3.new(2, 0, 0))
      iex> Vec3.distance(point, Vec3.new(1, 2, 0)) < 1.0e-15
      true
  """

  alias BB.Math.{Quaternion, Vec3}

  @enforce_keys [:m]
  defstruct [:m]

  @typedoc "A transform. The last row of its matrix is 0, 0, 0, 1."
  @type t :: %__MODULE__{m: tuple()}

  @typedoc "An origin as URDF has it: metres, and roll, pitch and yaw in radians."
  @type origin :: %{
          :position => {number(), number(), number()},
          :orientation => {number(), number(), number()},
          optional(atom()) => term()
        }

  @doc "Creates the transform that rotates, then translates."
  @spec new(Quaternion.t(), Vec3.t()) :: t()
  def new(%Quaternion{} = rotation, %Vec3{} = translation),
    do: from_rows(Quaternion.to_rotation_list(rotation), translation)

  @doc """
  Creates the transform that rotates, then translates, with the translation as the first
  argument.
  """
  @spec from_position_quaternion(Vec3.t(), Quaternion.t()) :: t()
  def from_position_quaternion(%Vec3{} = position, %Quaternion{} = rotation),
    do: new(rotation, position)

  defp from_rows([[a, b, c], [d, e, f], [g, h, i]], %Vec3{x: x, y: y, z: z}),
    do: %__MODULE__{m: {a, b, c, x, d, e, f, y, g, h, i, z, 0.0, 0.0, 0.0, 1.0}}

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
  @spec from_quaternion(Quaternion.t()) :: t()
  def from_quaternion(%Quaternion{} = rotation), do: new(rotation, Vec3.zero())

  @doc "Returns a rotation about the origin. Another name of `from_quaternion/1`."
  @spec from_rotation(Quaternion.t()) :: t()
  def from_rotation(%Quaternion{} = rotation), do: from_quaternion(rotation)

  @doc """
  Returns the rotation by `angle` radians about `axis`, a vector of length one.

  It does not normalise the axis; `BB.Math.Quaternion.from_axis_angle/2` does.
  """
  @spec from_axis_angle(Vec3.t(), number()) :: t()
  def from_axis_angle(%Vec3{x: x, y: y, z: z}, angle) when is_number(angle) do
    {c, s} = {:math.cos(angle), :math.sin(angle)}
    v = 1 - c

    from_rows(
      [
        [c + x * x * v, x * y * v - z * s, x * z * v + y * s],
        [y * x * v + z * s, c + y * y * v, y * z * v - x * s],
        [z * x * v - y * s, z * y * v + x * s, c + z * z * v]
      ],
      Vec3.zero()
    )
  end

  @doc "Returns the rotation by `angle` radians about x."
  @spec rotation_x(number()) :: t()
  def rotation_x(angle), do: from_axis_angle(Vec3.unit_x(), angle)

  @doc "Returns the rotation by `angle` radians about y."
  @spec rotation_y(number()) :: t()
  def rotation_y(angle), do: from_axis_angle(Vec3.unit_y(), angle)

  @doc "Returns the rotation by `angle` radians about z."
  @spec rotation_z(number()) :: t()
  def rotation_z(angle), do: from_axis_angle(Vec3.unit_z(), angle)

  @doc """
  Returns the translation by a vector.

      iex> alias BB.Math.{Transform, Vec3}
      iex> Transform.apply_to_point(Transform.translation(Vec3.unit_x()), Vec3.unit_y())
      Vec3.new(1, 1, 0)

  It also takes a transform and returns its translation, as `get_translation/1` does.
  """
  @spec translation(Vec3.t()) :: t()
  @spec translation(t()) :: Vec3.t()
  def translation(%Vec3{} = vector), do: new(Quaternion.identity(), vector)
  def translation(%__MODULE__{} = transform), do: get_translation(transform)

  @doc "Returns the translation by a vector. Another name of `translation/1`."
  @spec from_translation(Vec3.t()) :: t()
  def from_translation(%Vec3{} = vector), do: translation(vector)

  @doc "Returns the translation by `distance` times `axis`."
  @spec translation_along(Vec3.t(), number()) :: t()
  def translation_along(%Vec3{} = axis, distance) when is_number(distance),
    do: translation(Vec3.scale(axis, distance))

  @doc """
  Returns the transform of an origin: roll about x, then pitch about the new y, then yaw about the
  new z, and the translation in the rotated frame. For `nil`, returns the identity.

      iex> alias BB.Math.{Transform, Vec3}
      iex> origin = %{position: {1, 2, 3}, orientation: {0, 0, :math.pi() / 2}}
      iex> moved = origin |> Transform.from_origin() |> Transform.get_translation()
      iex> Vec3.distance(moved, Vec3.new(-2, 1, 3)) < 1.0e-15
      true
  """
  @spec from_origin(origin() | nil) :: t()
  def from_origin(nil), do: identity()

  def from_origin(%{position: {x, y, z}, orientation: {roll, pitch, yaw}}) do
    compose_all([
      rotation_x(roll),
      rotation_y(pitch),
      rotation_z(yaw),
      translation(Vec3.new(x, y, z))
    ])
  end

  @doc "Returns the translation of the transform."
  @spec get_translation(t()) :: Vec3.t()
  def get_translation(%__MODULE__{m: m}),
    do: %Vec3{x: elem(m, 3), y: elem(m, 7), z: elem(m, 11)}

  @doc "Returns the rotation of the transform."
  @spec get_quaternion(t()) :: Quaternion.t()
  def get_quaternion(%__MODULE__{} = transform),
    do: transform |> get_rotation_list() |> Quaternion.from_rotation_matrix()

  @doc "Returns the rotation of the transform. Another name of `get_quaternion/1`."
  @spec rotation(t()) :: Quaternion.t()
  def rotation(%__MODULE__{} = transform), do: get_quaternion(transform)

  @doc """
  Returns the matrix of the rotation as three rows of three floats.

      iex> BB.Math.Transform.get_rotation_list(BB.Math.Transform.identity())
      [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
  """
  @spec get_rotation_list(t()) :: [[float()]]
  def get_rotation_list(%__MODULE__{m: {a, b, c, _, d, e, f, _, g, h, i, _, _, _, _, _}}),
    do: [[a, b, c], [d, e, f], [g, h, i]]

  @doc "Returns the direction of the rotated x axis, the first column of the rotation."
  @spec get_right_vector(t()) :: Vec3.t()
  def get_right_vector(%__MODULE__{} = transform), do: column(transform, 0)

  @doc "Returns the direction of the rotated y axis, the second column of the rotation."
  @spec get_up_vector(t()) :: Vec3.t()
  def get_up_vector(%__MODULE__{} = transform), do: column(transform, 1)

  @doc "Returns the direction of the rotated z axis, the third column of the rotation."
  @spec get_forward_vector(t()) :: Vec3.t()
  def get_forward_vector(%__MODULE__{} = transform), do: column(transform, 2)

  defp column(%{m: m}, column),
    do: %Vec3{x: elem(m, column), y: elem(m, 4 + column), z: elem(m, 8 + column)}

  @doc "Returns the element in `row` and `column`, each from 0 to 3."
  @spec at(t(), 0..3, 0..3) :: float()
  def at(%__MODULE__{m: m}, row, column) when row in 0..3 and column in 0..3,
    do: elem(m, 4 * row + column)

  @doc "Returns the sixteen elements, row by row."
  @spec to_list(t()) :: [float()]
  def to_list(%__MODULE__{m: m}), do: Tuple.to_list(m)

  @doc """
  Returns the transform `b` followed by `a`, the product of their matrices.

      iex> alias BB.Math.{Transform, Vec3}
      iex> turn = Transform.rotation_z(:math.pi() / 2)
      iex> step = Transform.translation(Vec3.unit_x())
      iex> point = Transform.apply_to_point(Transform.compose(turn, step), Vec3.unit_x())
      iex> Vec3.distance(point, Vec3.new(0, 2, 0)) < 1.0e-15
      true
  """
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

  @doc """
  Returns the product of all transforms from left to right, the identity for none.

      iex> alias BB.Math.{Transform, Vec3}
      iex> axes = [Vec3.unit_x(), Vec3.unit_y(), Vec3.unit_z()]
      iex> axes |> Enum.map(&Transform.translation/1) |> Transform.compose_all()
      Transform.translation(Vec3.new(1, 1, 1))
  """
  @spec compose_all([t()]) :: t()
  def compose_all(transforms) when is_list(transforms),
    do: Enum.reduce(transforms, identity(), &compose(&2, &1))

  @doc "Returns the inverse transform."
  @spec inverse(t()) :: t()
  def inverse(%__MODULE__{m: {a, b, c, x, d, e, f, y, g, h, i, z, _, _, _, _}}) do
    %__MODULE__{
      m:
        {a, d, g, -(a * x + d * y + g * z), b, e, h, -(b * x + e * y + h * z), c, f, i,
         -(c * x + f * y + i * z), 0.0, 0.0, 0.0, 1.0}
    }
  end

  @doc """
  Transforms a point: rotates, then translates it.

      iex> alias BB.Math.{Transform, Vec3}
      iex> point = Transform.apply_to_point(Transform.rotation_x(:math.pi() / 2), Vec3.unit_y())
      iex> Vec3.distance(point, Vec3.unit_z()) < 1.0e-15
      true
  """
  @spec apply_to_point(t(), Vec3.t()) :: Vec3.t()
  def apply_to_point(%__MODULE__{} = transform, %Vec3{} = point),
    do: Vec3.add(apply_vector(transform, point), get_translation(transform))

  @doc "Transforms a point. Another name of `apply_to_point/2`."
  @spec apply_point(t(), Vec3.t()) :: Vec3.t()
  def apply_point(%__MODULE__{} = transform, %Vec3{} = point),
    do: apply_to_point(transform, point)

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
