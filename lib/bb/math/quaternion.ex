defmodule BB.Math.Quaternion do
  @moduledoc """
  A rotation as a unit quaternion in Hamilton's convention, with the real part `w`.

  Use it for orientations, such as that of an inertial measurement unit, and to rotate vectors:

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> left = Quaternion.from_axis_angle(Vec3.unit_z(), :math.pi() / 2)
      iex> v = Quaternion.rotate(left, Vec3.unit_x())
      iex> Vec3.distance(v, Vec3.unit_y()) < 1.0e-15
      true

  `multiply(a, b)` rotates by `b` first and then by `a`, as matrices do. A quaternion and its
  negative are the same rotation.

  All functions expect unit quaternions. The length of a product of many drifts by rounding; call
  `normalize/1` from time to time.
  """

  alias BB.Math.Vec3

  @enforce_keys [:w, :x, :y, :z]
  defstruct [:w, :x, :y, :z]

  @type t :: %__MODULE__{w: float(), x: float(), y: float(), z: float()}

  @doc """
  Returns the unit quaternion in the direction of four numbers.

  Raises `ArgumentError` if all of them are zero.

      iex> BB.Math.Quaternion.new(2, 0, 0, 0)
      BB.Math.Quaternion.identity()
  """
  @spec new(number(), number(), number(), number()) :: t()
  def new(w, x, y, z) when is_number(w) and is_number(x) and is_number(y) and is_number(z),
    do:
      normalize(%__MODULE__{
        w: :erlang.float(w),
        x: :erlang.float(x),
        y: :erlang.float(y),
        z: :erlang.float(z)
      })

  @doc "Returns the rotation by no angle."
  @spec identity() :: t()
  def identity, do: %__MODULE__{w: 1.0, x: 0.0, y: 0.0, z: 0.0}

  @doc "Returns the real part."
  @spec w(t()) :: float()
  def w(%__MODULE__{w: w}), do: w

  @doc "Returns the first imaginary part."
  @spec x(t()) :: float()
  def x(%__MODULE__{x: x}), do: x

  @doc "Returns the second imaginary part."
  @spec y(t()) :: float()
  def y(%__MODULE__{y: y}), do: y

  @doc "Returns the third imaginary part."
  @spec z(t()) :: float()
  def z(%__MODULE__{z: z}), do: z

  @doc """
  Returns the rotation by `angle` radians about `axis`, a vector of any length.

  About the zero vector it is the rotation by no angle.
  """
  @spec from_axis_angle(Vec3.t(), number()) :: t()
  def from_axis_angle(%Vec3{} = axis, angle) when is_number(angle) do
    %{x: x, y: y, z: z} = axis |> Vec3.normalize() |> Vec3.scale(:math.sin(angle / 2))
    if Vec3.norm_squared(axis) == 0, do: identity(), else: new(:math.cos(angle / 2), x, y, z)
  end

  @doc """
  Returns the axis, of length one, and the angle, from 0 to π. If the angle is 0, the axis is x.

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> Quaternion.to_axis_angle(Quaternion.identity())
      {Vec3.unit_x(), 0.0}
  """
  @spec to_axis_angle(t()) :: {Vec3.t(), float()}
  def to_axis_angle(%__MODULE__{w: w} = q) when w < 0, do: to_axis_angle(negate(q))

  def to_axis_angle(%__MODULE__{} = q) do
    imaginary = Vec3.new(q.x, q.y, q.z)
    sine = Vec3.norm(imaginary)
    axis = if sine == 0, do: Vec3.unit_x(), else: Vec3.normalize(imaginary)
    {axis, 2 * :math.atan2(sine, q.w)}
  end

  @doc """
  Returns the rotation by roll about x, then pitch about y, then yaw about z, all about fixed axes
  and in radians.
  """
  @spec from_euler(number(), number(), number()) :: t()
  def from_euler(roll, pitch, yaw) do
    from_axis_angle(Vec3.unit_z(), yaw)
    |> multiply(from_axis_angle(Vec3.unit_y(), pitch))
    |> multiply(from_axis_angle(Vec3.unit_x(), roll))
  end

  @doc """
  Returns `{roll, pitch, yaw}` in radians, the inverse of `from_euler/3`.

  Pitch is from -π/2 to π/2. At ±π/2, roll and yaw rotate about the same axis, and only their
  difference or sum is determined.
  """
  @spec to_euler(t()) :: {float(), float(), float()}
  def to_euler(%__MODULE__{w: w, x: x, y: y, z: z}) do
    sine = max(-1.0, min(1.0, 2 * (w * y - z * x)))

    {:math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), :math.asin(sine),
     :math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))}
  end

  @doc "Returns the product: the rotation by `b`, then by `a`."
  @spec multiply(t(), t()) :: t()
  def multiply(%__MODULE__{} = a, %__MODULE__{} = b) do
    %__MODULE__{
      w: a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
      x: a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
      y: a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
      z: a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w
    }
  end

  @doc "Returns the conjugate, which is the inverse of a unit quaternion."
  @spec conjugate(t()) :: t()
  def conjugate(%__MODULE__{} = q), do: %{q | x: -q.x, y: -q.y, z: -q.z}

  @doc "Returns the inverse rotation."
  @spec inverse(t()) :: t()
  def inverse(%__MODULE__{} = q) do
    square = dot(q, q)
    %__MODULE__{w: q.w / square, x: -q.x / square, y: -q.y / square, z: -q.z / square}
  end

  @doc "Returns the quaternion with all signs changed, which is the same rotation."
  @spec negate(t()) :: t()
  def negate(%__MODULE__{} = q), do: %__MODULE__{w: -q.w, x: -q.x, y: -q.y, z: -q.z}

  @doc "Returns the dot product of the four elements, ±1 for the same rotation."
  @spec dot(t(), t()) :: float()
  def dot(%__MODULE__{} = a, %__MODULE__{} = b), do: a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z

  @doc "Returns the length, which is one apart from rounding."
  @spec norm(t()) :: float()
  def norm(%__MODULE__{} = q), do: :math.sqrt(dot(q, q))

  @doc "Returns the quaternion with length one. Raises `ArgumentError` if all elements are zero."
  @spec normalize(t()) :: t()
  def normalize(%__MODULE__{} = q) do
    norm = norm(q)
    if norm == 0, do: raise(ArgumentError, "expected a rotation, got: a quaternion of four zeros")
    %__MODULE__{w: q.w / norm, x: q.x / norm, y: q.y / norm, z: q.z / norm}
  end

  @doc "Returns the vector after the rotation."
  @spec rotate(t(), Vec3.t()) :: Vec3.t()
  def rotate(%__MODULE__{} = q, %Vec3{} = v) do
    imaginary = %Vec3{x: q.x, y: q.y, z: q.z}
    t = Vec3.scale(Vec3.cross(imaginary, v), 2)
    v |> Vec3.add(Vec3.scale(t, q.w)) |> Vec3.add(Vec3.cross(imaginary, t))
  end

  @doc "Returns the angle between two rotations, from 0 to π radians."
  @spec angle(t(), t()) :: float()
  def angle(%__MODULE__{} = a, %__MODULE__{} = b) do
    {_axis, angle} = to_axis_angle(multiply(conjugate(a), b))
    angle
  end

  @doc """
  Interpolates between two rotations at constant angular speed.

  Returns the rotation at the fraction `t` of the shorter way from `a` to `b`.

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> quarter = Quaternion.from_axis_angle(Vec3.unit_z(), 1.0)
      iex> half = Quaternion.slerp(Quaternion.identity(), quarter, 0.5)
      iex> abs(Quaternion.angle(half, quarter) - 0.5) < 1.0e-12
      true
  """
  @spec slerp(t(), t(), number()) :: t()
  def slerp(%__MODULE__{} = a, %__MODULE__{} = b, t) when is_number(t) do
    {axis, angle} = to_axis_angle(multiply(conjugate(a), b))
    multiply(a, from_axis_angle(axis, angle * t))
  end
end
