defmodule BB.Math.Quaternion do
  @moduledoc """
  A rotation as a unit quaternion in Hamilton's convention, with the real part `w`.

  Use it for orientations, such as that of an inertial measurement unit, and to rotate vectors:

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> left = Quaternion.from_axis_angle(Vec3.unit_z(), :math.pi() / 2)
      iex> v = Quaternion.rotate_vector(left, Vec3.unit_x())
      iex> Vec3.distance(v, Vec3.unit_y()) < 1.0e-15
      true

  `multiply(a, b)` rotates by `b` first and then by `a`, as matrices do. A quaternion and its
  negative are the same rotation.

  All functions expect unit quaternions. The length of a product of many drifts by rounding; call
  `normalise/1` from time to time. `BB.Math.Euler` has the formulas of roll, pitch and yaw,
  `BB.Math.RotationMatrix` those of matrices.
  """

  alias BB.Math.{Euler, RotationMatrix, Vec3}

  @enforce_keys [:w, :x, :y, :z]
  defstruct [:w, :x, :y, :z]

  @type t :: %__MODULE__{w: float(), x: float(), y: float(), z: float()}

  # A shorter vector has no direction.
  @shortest 1.0e-10

  @doc """
  Returns the unit quaternion in the direction of four numbers.

  Raises `ArgumentError` if all of them are zero.

      iex> BB.Math.Quaternion.new(2, 0, 0, 0)
      BB.Math.Quaternion.identity()
  """
  @spec new(number(), number(), number(), number()) :: t()
  def new(w, x, y, z) when is_number(w) and is_number(x) and is_number(y) and is_number(z),
    do: normalise(%__MODULE__{w: w / 1, x: x / 1, y: y / 1, z: z / 1})

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
  Returns the elements in order, with the real part first.

      iex> BB.Math.Quaternion.to_list(BB.Math.Quaternion.identity())
      [1.0, 0.0, 0.0, 0.0]
  """
  @spec to_list(t()) :: [float()]
  def to_list(%__MODULE__{w: w, x: x, y: y, z: z}), do: [w, x, y, z]

  @doc "Creates a quaternion from a list as `to_list/1` returns it, and normalises it."
  @spec from_list([number()]) :: t()
  def from_list([w, x, y, z]), do: new(w, x, y, z)

  @doc """
  Returns the elements with the real part last, as in ROS.

      iex> BB.Math.Quaternion.to_xyzw_list(BB.Math.Quaternion.identity())
      [0.0, 0.0, 0.0, 1.0]
  """
  @spec to_xyzw_list(t()) :: [float()]
  def to_xyzw_list(%__MODULE__{w: w, x: x, y: y, z: z}), do: [x, y, z, w]

  @doc "Creates a quaternion from a list as `to_xyzw_list/1` returns it, and normalises it."
  @spec from_xyzw_list([number()]) :: t()
  def from_xyzw_list([x, y, z, w]), do: new(w, x, y, z)

  @doc """
  Returns the rotation by `angle` radians about `axis`, a vector of any length.

  An axis shorter than 1.0e-10 has no direction, and counts as z.
  """
  @spec from_axis_angle(Vec3.t(), number()) :: t()
  def from_axis_angle(%Vec3{} = axis, angle) when is_number(angle) do
    %{x: x, y: y, z: z} = axis |> direction(Vec3.unit_z()) |> Vec3.scale(:math.sin(angle / 2))
    new(:math.cos(angle / 2), x, y, z)
  end

  defp direction(vector, default) do
    if Vec3.magnitude(vector) < @shortest, do: default, else: Vec3.normalise(vector)
  end

  @doc """
  Returns the axis, of length one, and the angle, from 0 to 2π. If the angle is 0, the axis is z.

  A quaternion with a negative real part has an angle above π. `to_shortest_axis_angle/1` returns
  the same rotation with an angle of at most π.

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> Quaternion.to_axis_angle(Quaternion.identity())
      {Vec3.unit_z(), 0.0}
  """
  @spec to_axis_angle(t()) :: {Vec3.t(), float()}
  def to_axis_angle(%__MODULE__{} = q) do
    imaginary = %Vec3{x: q.x, y: q.y, z: q.z}
    # 2 · acos w, without its loss of digits near w = 1.
    {direction(imaginary, Vec3.unit_z()), 2 * :math.atan2(Vec3.magnitude(imaginary), q.w)}
  end

  @doc """
  Returns the axis, of length one, and the angle, from 0 to π.

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> long_way = Quaternion.from_axis_angle(Vec3.unit_x(), 1.5 * :math.pi())
      iex> {axis, angle} = Quaternion.to_shortest_axis_angle(long_way)
      iex> axis == Vec3.negate(Vec3.unit_x()) and abs(angle - :math.pi() / 2) < 1.0e-15
      true
  """
  @spec to_shortest_axis_angle(t()) :: {Vec3.t(), float()}
  def to_shortest_axis_angle(%__MODULE__{w: w} = q) when w < 0, do: to_axis_angle(negate(q))
  def to_shortest_axis_angle(%__MODULE__{} = q), do: to_axis_angle(q)

  @doc """
  Returns the rotation with the given roll about x, pitch about y and yaw about z, in radians.

  The order says in which order they apply:

    * `:xyz` - R = Rx(roll) · Ry(pitch) · Rz(yaw): about x, then about the new y, then about the
      new z
    * `:zyx` - R = Rz(yaw) · Ry(pitch) · Rx(roll): about the fixed x, then the fixed y, then the
      fixed z, as URDF and ROS have it

  Any other order is `:xyz`.

      iex> q = BB.Math.Quaternion.from_euler(0.1, 0.2, 0.3)
      iex> for element <- BB.Math.Quaternion.to_list(q), do: Float.round(element, 9)
      [0.981856173, 0.064071348, 0.091157549, 0.153439302]
  """
  @spec from_euler(number(), number(), number(), Euler.order()) :: t()
  def from_euler(roll, pitch, yaw, order \\ :xyz)
      when is_number(roll) and is_number(pitch) and is_number(yaw) and is_atom(order) do
    x = from_axis_angle(Vec3.unit_x(), roll)
    y = from_axis_angle(Vec3.unit_y(), pitch)
    z = from_axis_angle(Vec3.unit_z(), yaw)

    case order do
      :zyx -> z |> multiply(y) |> multiply(x)
      _xyz -> x |> multiply(y) |> multiply(z)
    end
  end

  @doc """
  Returns `{roll, pitch, yaw}` in radians, the inverse of `from_euler/4`.

  Pitch is from -π/2 to π/2. Near ±π/2 (from about 0.26° on), roll and yaw rotate about the same
  axis: roll is 0 then, pitch ±π/2, and yaw has the whole rotation.
  """
  @spec to_euler(t(), Euler.order()) :: {float(), float(), float()}
  def to_euler(%__MODULE__{} = q, order \\ :xyz) when is_atom(order),
    do: q |> to_rotation_list() |> Euler.from_rows(order)

  @doc """
  Returns the shortest rotation that turns the direction of `a` to the direction of `b`.

  For opposite directions, it is half a turn about an axis that is perpendicular to `a`. The zero
  vector counts as x.

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> q = Quaternion.from_two_vectors(Vec3.new(1, 1, 0), Vec3.new(0, 1, 1))
      iex> for element <- Quaternion.to_list(q), do: Float.round(element, 9)
      [0.866025404, 0.288675135, -0.288675135, 0.288675135]
  """
  @spec from_two_vectors(Vec3.t(), Vec3.t()) :: t()
  def from_two_vectors(%Vec3{} = a, %Vec3{} = b) do
    a = direction(a, Vec3.unit_x())
    b = direction(b, Vec3.unit_x())
    cosine = Vec3.dot(a, b)
    if cosine < -0.9999, do: over_half_turn(a, b), else: shortest(a, b, cosine)
  end

  # The cross product of nearly opposite directions is imprecise: the rotation goes by -a.
  defp over_half_turn(a, b) do
    half_turn = from_axis_angle(Vec3.perpendicular(a), :math.pi())
    opposite = Vec3.negate(a)
    opposite |> shortest(b, Vec3.dot(opposite, b)) |> multiply(half_turn)
  end

  defp shortest(a, b, cosine) do
    %{x: x, y: y, z: z} = Vec3.cross(a, b)
    new(1 + cosine, x, y, z)
  end

  @doc """
  Returns the rotation of a matrix, given as three rows of three numbers.

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> Quaternion.from_rotation_matrix([[-1, 0, 0], [0, -1, 0], [0, 0, 1]])
      Quaternion.new(0, 0, 0, 1)
  """
  @spec from_rotation_matrix([[number()]]) :: t()
  def from_rotation_matrix([[_, _, _], [_, _, _], [_, _, _]] = rows),
    do: rows |> RotationMatrix.to_quaternion() |> from_list()

  @doc """
  Returns the matrix of the rotation as three rows of three floats.

      iex> BB.Math.Quaternion.to_rotation_list(BB.Math.Quaternion.identity())
      [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
  """
  @spec to_rotation_list(t()) :: [[float()]]
  def to_rotation_list(%__MODULE__{w: w, x: x, y: y, z: z}),
    do: RotationMatrix.from_quaternion(w, x, y, z)

  @doc """
  Returns the product: the rotation by `b`, then by `a`.

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> about_z = Quaternion.from_axis_angle(Vec3.unit_z(), :math.pi() / 2)
      iex> about_x = Quaternion.from_axis_angle(Vec3.unit_x(), :math.pi() / 2)
      iex> q = Quaternion.multiply(about_z, about_x)
      iex> for element <- Quaternion.to_list(q), do: Float.round(element, 9)
      [0.5, 0.5, 0.5, 0.5]
  """
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
  @spec normalise(t()) :: t()
  def normalise(%__MODULE__{} = q) do
    norm = norm(q)
    if norm == 0, do: raise(ArgumentError, "expected a rotation, got: a quaternion of four zeros")
    %__MODULE__{w: q.w / norm, x: q.x / norm, y: q.y / norm, z: q.z / norm}
  end

  @doc "Returns the quaternion with length one. Another name of `normalise/1`."
  @spec normalize(t()) :: t()
  def normalize(%__MODULE__{} = q), do: normalise(q)

  @doc """
  Returns the vector after the rotation.

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> q = Quaternion.from_euler(0.1, 0.2, 0.3)
      iex> v = Quaternion.rotate_vector(q, Vec3.new(1, 2, 3))
      iex> for element <- Vec3.to_list(v), do: Float.round(element, 9)
      [0.953042401, 1.908866613, 3.073749898]
  """
  @spec rotate_vector(t(), Vec3.t()) :: Vec3.t()
  def rotate_vector(%__MODULE__{} = q, %Vec3{} = v) do
    imaginary = %Vec3{x: q.x, y: q.y, z: q.z}
    t = Vec3.scale(Vec3.cross(imaginary, v), 2)
    v |> Vec3.add(Vec3.scale(t, q.w)) |> Vec3.add(Vec3.cross(imaginary, t))
  end

  @doc "Returns the vector after the rotation. Another name of `rotate_vector/2`."
  @spec rotate(t(), Vec3.t()) :: Vec3.t()
  def rotate(%__MODULE__{} = q, %Vec3{} = v), do: rotate_vector(q, v)

  @doc """
  Returns the angle between two rotations, from 0 to π radians.

      iex> alias BB.Math.Quaternion
      iex> q = Quaternion.new(1, 2, 3, 4)
      iex> Quaternion.angular_distance(q, Quaternion.negate(q))
      0.0
  """
  @spec angular_distance(t(), t()) :: float()
  def angular_distance(%__MODULE__{} = a, %__MODULE__{} = b) do
    {_axis, angle} = to_shortest_axis_angle(multiply(conjugate(a), b))
    angle
  end

  @doc "Returns the angle between two rotations. Another name of `angular_distance/2`."
  @spec angle(t(), t()) :: float()
  def angle(%__MODULE__{} = a, %__MODULE__{} = b), do: angular_distance(a, b)

  @doc """
  Returns the rotation about the same axis by `factor` times the angle, on the shorter way.

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> third = Quaternion.power(Quaternion.from_axis_angle(Vec3.unit_z(), 1.5), 1 / 3)
      iex> {_axis, angle} = Quaternion.to_axis_angle(third)
      iex> Float.round(angle, 12)
      0.5
  """
  @spec power(t(), number()) :: t()
  def power(%__MODULE__{} = q, factor) when is_number(factor) do
    {axis, angle} = to_shortest_axis_angle(q)
    from_axis_angle(axis, angle * factor)
  end

  @doc """
  Interpolates between two rotations at constant angular speed.

  Returns the rotation at the fraction `t`, from 0 to 1, of the shorter way from `a` to `b`. To
  extrapolate, use `power/2`.

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> quarter = Quaternion.from_axis_angle(Vec3.unit_z(), :math.pi() / 2)
      iex> half = Quaternion.slerp(Quaternion.identity(), quarter, 0.5)
      iex> for element <- Quaternion.to_list(half), do: Float.round(element, 9)
      [0.923879533, 0.0, 0.0, 0.382683432]
  """
  @spec slerp(t(), t(), number()) :: t()
  def slerp(%__MODULE__{} = a, %__MODULE__{} = b, t) when is_number(t) and t >= 0 and t <= 1,
    do: multiply(a, power(multiply(conjugate(a), b), t))

  defimpl Inspect do
    import Inspect.Algebra

    def inspect(%{w: w, x: x, y: y, z: z}, opts),
      do: container_doc("BB.Math.Quaternion.new(", [w, x, y, z], ")", opts, &to_doc/2)
  end
end
