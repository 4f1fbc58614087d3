defmodule BB.Math.Transform2D do
  @moduledoc """
  A rigid motion in the plane: a rotation by `theta` radians, counter-clockwise, then a translation by `x` and `y`.

      iex> alias BB.Math.Transform2D
      iex> step = Transform2D.new(1, 0, :math.pi() / 2)
      iex> {x, y} = step |> Transform2D.compose(step) |> Transform2D.apply_point({0.0, 0.0})
      iex> {Float.round(x, 12), Float.round(y, 12)}
      {1.0, 1.0}
  """

  @enforce_keys [:x, :y, :theta]
  defstruct [:x, :y, :theta]

  @typedoc "`theta` is in -π..π."
  @type t :: %__MODULE__{x: float(), y: float(), theta: float()}

  @type point :: {number(), number()}

  @doc "The motion by `x` and `y` after the rotation by `theta`."
  @spec new(number(), number(), number()) :: t()
  def new(x, y, theta) when is_number(x) and is_number(y) and is_number(theta),
    do: %__MODULE__{x: :erlang.float(x), y: :erlang.float(y), theta: wrap(theta)}

  @doc "The motion that moves nothing."
  @spec identity() :: t()
  def identity, do: new(0, 0, 0)

  @doc "The motion `b`, then the motion `a`."
  @spec compose(t(), t()) :: t()
  def compose(%__MODULE__{} = a, %__MODULE__{} = b) do
    {x, y} = apply_point(a, {b.x, b.y})
    new(x, y, a.theta + b.theta)
  end

  @doc "The motion that undoes this one."
  @spec inverse(t()) :: t()
  def inverse(%__MODULE__{} = t) do
    {x, y} = turn({-t.x, -t.y}, -t.theta)
    new(x, y, -t.theta)
  end

  @doc "Where the motion takes a point."
  @spec apply_point(t(), point()) :: {float(), float()}
  def apply_point(%__MODULE__{} = t, point) do
    {x, y} = turn(point, t.theta)
    {x + t.x, y + t.y}
  end

  defp turn({x, y}, theta) do
    {sine, cosine} = {:math.sin(theta), :math.cos(theta)}
    {x * cosine - y * sine, x * sine + y * cosine}
  end

  defp wrap(theta) when theta >= -3.141592653589793 and theta <= 3.141592653589793,
    do: :erlang.float(theta)

  defp wrap(theta), do: :math.atan2(:math.sin(theta), :math.cos(theta))
end
