defmodule BB.Math.Vec3 do
  @moduledoc """
  A vector of three floats.

  Messages use it for accelerations, velocities, forces and positions:

      iex> alias BB.Math.Vec3
      iex> Vec3.new(1, 2, 3) |> Vec3.add(Vec3.unit_x()) |> Vec3.scale(2)
      BB.Math.Vec3.new(4.0, 4.0, 6.0)
  """

  @enforce_keys [:x, :y, :z]
  defstruct [:x, :y, :z]

  # The direction of a shorter vector is noise.
  @shortest 1.0e-10

  @type t :: %__MODULE__{x: float(), y: float(), z: float()}

  @doc "Creates a vector from three numbers."
  @spec new(number(), number(), number()) :: t()
  def new(x, y, z) when is_number(x) and is_number(y) and is_number(z),
    do: %__MODULE__{x: :erlang.float(x), y: :erlang.float(y), z: :erlang.float(z)}

  @doc "Returns the zero vector."
  @spec zero() :: t()
  def zero, do: %__MODULE__{x: 0.0, y: 0.0, z: 0.0}

  @doc "Returns the unit vector in x, (1, 0, 0)."
  @spec unit_x() :: t()
  def unit_x, do: %__MODULE__{x: 1.0, y: 0.0, z: 0.0}

  @doc "Returns the unit vector in y, (0, 1, 0)."
  @spec unit_y() :: t()
  def unit_y, do: %__MODULE__{x: 0.0, y: 1.0, z: 0.0}

  @doc "Returns the unit vector in z, (0, 0, 1)."
  @spec unit_z() :: t()
  def unit_z, do: %__MODULE__{x: 0.0, y: 0.0, z: 1.0}

  @doc "Returns the first element."
  @spec x(t()) :: float()
  def x(%__MODULE__{x: x}), do: x

  @doc "Returns the second element."
  @spec y(t()) :: float()
  def y(%__MODULE__{y: y}), do: y

  @doc "Returns the third element."
  @spec z(t()) :: float()
  def z(%__MODULE__{z: z}), do: z

  @doc """
  Returns the elements in order.

      iex> BB.Math.Vec3.to_list(BB.Math.Vec3.unit_y())
      [0.0, 1.0, 0.0]
  """
  @spec to_list(t()) :: [float()]
  def to_list(%__MODULE__{x: x, y: y, z: z}), do: [x, y, z]

  @doc "Creates a vector from a list of three numbers."
  @spec from_list([number()]) :: t()
  def from_list([x, y, z]), do: new(x, y, z)

  @doc "Returns the sum."
  @spec add(t(), t()) :: t()
  def add(%__MODULE__{} = a, %__MODULE__{} = b),
    do: %__MODULE__{x: a.x + b.x, y: a.y + b.y, z: a.z + b.z}

  @doc "Returns the first vector minus the second."
  @spec subtract(t(), t()) :: t()
  def subtract(%__MODULE__{} = a, %__MODULE__{} = b),
    do: %__MODULE__{x: a.x - b.x, y: a.y - b.y, z: a.z - b.z}

  @doc "Returns the vector in the opposite direction."
  @spec negate(t()) :: t()
  def negate(%__MODULE__{} = v), do: %__MODULE__{x: -v.x, y: -v.y, z: -v.z}

  @doc "Multiplies the vector by a number."
  @spec scale(t(), number()) :: t()
  def scale(%__MODULE__{} = v, factor) when is_number(factor),
    do: %__MODULE__{x: v.x * factor, y: v.y * factor, z: v.z * factor}

  @doc """
  Returns the dot product.

      iex> BB.Math.Vec3.dot(BB.Math.Vec3.new(1, 2, 3), BB.Math.Vec3.new(4, 5, 6))
      32.0
  """
  @spec dot(t(), t()) :: float()
  def dot(%__MODULE__{} = a, %__MODULE__{} = b), do: a.x * b.x + a.y * b.y + a.z * b.z

  @doc """
  Returns the cross product, which is perpendicular to both vectors, by the right-hand rule.

      iex> BB.Math.Vec3.cross(BB.Math.Vec3.unit_x(), BB.Math.Vec3.unit_y())
      BB.Math.Vec3.unit_z()
  """
  @spec cross(t(), t()) :: t()
  def cross(%__MODULE__{} = a, %__MODULE__{} = b) do
    %__MODULE__{
      x: a.y * b.z - a.z * b.y,
      y: a.z * b.x - a.x * b.z,
      z: a.x * b.y - a.y * b.x
    }
  end

  @doc """
  Returns the length.

      iex> BB.Math.Vec3.magnitude(BB.Math.Vec3.new(3, 4, 0))
      5.0
  """
  @spec magnitude(t()) :: float()
  def magnitude(%__MODULE__{} = v), do: :math.sqrt(magnitude_squared(v))

  @doc """
  Returns the square of the length.

      iex> BB.Math.Vec3.magnitude_squared(BB.Math.Vec3.new(3, 4, 0))
      25.0
  """
  @spec magnitude_squared(t()) :: float()
  def magnitude_squared(%__MODULE__{} = v), do: dot(v, v)

  @doc "Returns the length. Another name of `magnitude/1`."
  @spec norm(t()) :: float()
  def norm(%__MODULE__{} = v), do: magnitude(v)

  @doc "Returns the square of the length. Another name of `magnitude_squared/1`."
  @spec norm_squared(t()) :: float()
  def norm_squared(%__MODULE__{} = v), do: magnitude_squared(v)

  @doc "Returns the length of the difference."
  @spec distance(t(), t()) :: float()
  def distance(%__MODULE__{} = a, %__MODULE__{} = b), do: magnitude(subtract(a, b))

  @doc """
  Returns the vector of length one in the same direction, or the zero vector for a vector shorter
  than 1.0e-10, whose direction is noise.

  `normalize/1` has no such limit.

      iex> BB.Math.Vec3.normalise(BB.Math.Vec3.new(0, 0, 4))
      BB.Math.Vec3.unit_z()
      iex> BB.Math.Vec3.normalise(BB.Math.Vec3.new(0, 0, 1.0e-11))
      BB.Math.Vec3.zero()
  """
  @spec normalise(t()) :: t()
  def normalise(%__MODULE__{} = v) do
    magnitude = magnitude(v)
    if magnitude < @shortest, do: zero(), else: divide(v, magnitude)
  end

  @doc """
  Returns the vector of length one in the same direction. For the zero vector, returns the zero
  vector.

      iex> BB.Math.Vec3.normalize(BB.Math.Vec3.new(0, 0, 4))
      BB.Math.Vec3.unit_z()
  """
  @spec normalize(t()) :: t()
  def normalize(%__MODULE__{} = v) do
    magnitude = magnitude(v)
    if magnitude == 0, do: zero(), else: divide(v, magnitude)
  end

  defp divide(v, divisor), do: %__MODULE__{x: v.x / divisor, y: v.y / divisor, z: v.z / divisor}

  @doc """
  Returns a vector of length one that is perpendicular to the vector.

      iex> BB.Math.Vec3.perpendicular(BB.Math.Vec3.new(5, 0, 0))
      BB.Math.Vec3.unit_y()
  """
  @spec perpendicular(t()) :: t()
  def perpendicular(%__MODULE__{} = v) do
    %{z: z} = direction = normalise(v)
    seed = if abs(z) < 0.9, do: unit_z(), else: unit_y()
    perpendicular = normalise(cross(seed, direction))
    if perpendicular == zero(), do: unit_x(), else: perpendicular
  end

  @doc """
  Interpolates between two points. Returns the point at the fraction `t` of the way from `a` to
  `b`, exactly `a` at 0 and `b` at 1. Outside of these `t` extrapolates.

      iex> BB.Math.Vec3.lerp(BB.Math.Vec3.zero(), BB.Math.Vec3.new(2, 4, 8), 0.25)
      BB.Math.Vec3.new(0.5, 1, 2)
  """
  @spec lerp(t(), t(), number()) :: t()
  def lerp(%__MODULE__{} = a, %__MODULE__{} = b, t) when is_number(t),
    do: add(scale(a, 1 - t), scale(b, t))

  defimpl Inspect do
    import Inspect.Algebra

    def inspect(%{x: x, y: y, z: z}, opts),
      do: container_doc("BB.Math.Vec3.new(", [x, y, z], ")", opts, &to_doc/2)
  end
end
