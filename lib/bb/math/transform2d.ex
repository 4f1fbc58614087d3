defmodule BB.Math.Transform2D do
  @moduledoc """
  A rigid transform in the plane: a rotation by `theta` radians, counter-clockwise, then a
  translation by `x` and `y`.

  Use it for joints and bodies that move in a plane, such as the base of a robot on wheels:

      iex> alias BB.Math.Transform2D
      iex> step = Transform2D.new(1, 0, :math.pi() / 2)
      iex> {x, y} = step |> Transform2D.compose(step) |> Transform2D.apply_point({0.0, 0.0})
      iex> {Float.round(x, 12), Float.round(y, 12)}
      {1.0, 1.0}

  The angle counts turns: composing 3.0 and 3.0 gives 6.0. `wrap/1` takes whole turns away.
  """

  alias BB.Math.{Transform, Vec3}

  @enforce_keys [:x, :y, :theta]
  defstruct [:x, :y, :theta]

  @type t :: %__MODULE__{x: float(), y: float(), theta: float()}

  @type point :: {number(), number()}

  @doc "Creates the transform that rotates by `theta`, then translates by `x` and `y`."
  @spec new(number(), number(), number()) :: t()
  def new(x, y, theta) when is_number(x) and is_number(y) and is_number(theta),
    do: %__MODULE__{x: x / 1, y: y / 1, theta: theta / 1}

  @doc "Returns the transform that changes nothing."
  @spec identity() :: t()
  def identity, do: new(0, 0, 0)

  @doc """
  Returns the transform `b` followed by `a`.

      iex> alias BB.Math.Transform2D
      iex> Transform2D.compose(Transform2D.new(1, 2, 3.0), Transform2D.new(0, 0, 3.0))
      Transform2D.new(1, 2, 6.0)
  """
  @spec compose(t(), t()) :: t()
  def compose(%__MODULE__{} = a, %__MODULE__{} = b) do
    {x, y} = apply_point(a, {b.x, b.y})
    new(x, y, a.theta + b.theta)
  end

  @doc "Returns the inverse transform."
  @spec inverse(t()) :: t()
  def inverse(%__MODULE__{} = t) do
    {x, y} = rotate({-t.x, -t.y}, -t.theta)
    new(x, y, -t.theta)
  end

  @doc """
  Returns the transform with its angle from -π to π.

      iex> wrapped = BB.Math.Transform2D.wrap(BB.Math.Transform2D.new(0, 0, 6.0))
      iex> Float.round(wrapped.theta, 9)
      -0.283185307
  """
  @spec wrap(t()) :: t()
  def wrap(%__MODULE__{theta: theta} = t), do: %{t | theta: wrap_angle(theta)}

  defp wrap_angle(theta) when theta >= -3.141592653589793 and theta <= 3.141592653589793,
    do: theta

  defp wrap_angle(theta), do: :math.atan2(:math.sin(theta), :math.cos(theta))

  @doc "Transforms a point."
  @spec apply_point(t(), point()) :: {float(), float()}
  def apply_point(%__MODULE__{} = t, point) do
    {x, y} = rotate(point, t.theta)
    {x + t.x, y + t.y}
  end

  defp rotate({x, y}, theta) do
    {sine, cosine} = {:math.sin(theta), :math.cos(theta)}
    {x * cosine - y * sine, x * sine + y * cosine}
  end

  @doc """
  Returns the axes `{u, v}` of the plane that is perpendicular to `normal`, a vector of any
  length. They have length one, and u × v is the direction of the normal.

      iex> alias BB.Math.{Transform2D, Vec3}
      iex> Transform2D.plane_basis(Vec3.unit_z())
      {Vec3.unit_x(), Vec3.unit_y()}
  """
  @spec plane_basis(Vec3.t()) :: {Vec3.t(), Vec3.t()}
  def plane_basis(%Vec3{} = normal) do
    n = Vec3.normalise(normal)
    u = Vec3.perpendicular(n)
    {u, Vec3.cross(n, u)}
  end

  @doc """
  Returns the transform in space that moves in the plane perpendicular to `normal`: rotates by
  `theta` about the normal, then translates by `x` and `y` along the axes of `plane_basis/1`.

      iex> alias BB.Math.{Transform, Transform2D, Vec3}
      iex> lifted = Transform2D.to_transform(Transform2D.new(1, 2, :math.pi() / 2), Vec3.unit_z())
      iex> point = Transform.apply_to_point(lifted, Vec3.unit_x())
      iex> Vec3.distance(point, Vec3.new(1, 3, 0)) < 1.0e-15
      true
  """
  @spec to_transform(t(), Vec3.t()) :: Transform.t()
  def to_transform(%__MODULE__{x: x, y: y, theta: theta}, %Vec3{} = normal) do
    {u, v} = plane_basis(normal)

    Transform.compose(
      Transform.translation(Vec3.add(Vec3.scale(u, x), Vec3.scale(v, y))),
      Transform.from_axis_angle(Vec3.normalise(normal), theta)
    )
  end
end
