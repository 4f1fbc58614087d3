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
  """

  @enforce_keys [:x, :y, :theta]
  defstruct [:x, :y, :theta]

  @typedoc "A transform, with `theta` from -π to π."
  @type t :: %__MODULE__{x: float(), y: float(), theta: float()}

  @type point :: {number(), number()}

  @doc "Creates the transform that rotates by `theta`, then translates by `x` and `y`."
  @spec new(number(), number(), number()) :: t()
  def new(x, y, theta) when is_number(x) and is_number(y) and is_number(theta),
    do: %__MODULE__{x: :erlang.float(x), y: :erlang.float(y), theta: wrap(theta)}

  @doc "Returns the transform that changes nothing."
  @spec identity() :: t()
  def identity, do: new(0, 0, 0)

  @doc "Returns the transform `b` followed by `a`."
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

  defp wrap(theta) when theta >= -3.141592653589793 and theta <= 3.141592653589793,
    do: :erlang.float(theta)

  defp wrap(theta), do: :math.atan2(:math.sin(theta), :math.cos(theta))
end
