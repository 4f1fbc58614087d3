defmodule BB.Test.Math do
  @moduledoc "Generators of vectors, rotations and motions for `BB.Test.Prop`, and a comparison."

  alias BB.Math.{Quaternion, Transform, Transform2D, Vec3}
  alias BB.Test.Prop

  def coordinate, do: :proper_types.float(-100.0, 100.0)

  def vec3,
    do:
      Prop.map({coordinate(), coordinate(), coordinate()}, fn {x, y, z} -> Vec3.new(x, y, z) end)

  @doc "Generates a vector of length one."
  def direction do
    Prop.map(vec3(), fn v ->
      if Vec3.magnitude(v) < 1.0e-6, do: Vec3.unit_x(), else: Vec3.normalise(v)
    end)
  end

  @doc "Generates any rotation; axis and angle may be zero."
  def quaternion,
    do:
      Prop.map({vec3(), :proper_types.float(-7.0, 7.0)}, fn {axis, angle} ->
        Quaternion.from_axis_angle(axis, angle)
      end)

  def transform, do: Prop.map({quaternion(), vec3()}, fn {q, v} -> Transform.new(q, v) end)

  def transform2d,
    do:
      Prop.map({coordinate(), coordinate(), coordinate()}, fn {x, y, theta} ->
        Transform2D.new(x, y, theta)
      end)

  @doc """
  Tells whether two values of one of the types are equal but for rounding, which grows with the
  values.
  """
  def close?(a, b) when is_number(a), do: abs(a - b) <= 1.0e-9 * (1 + abs(a) + abs(b))
  def close?(%Vec3{} = a, b), do: close_all?(Vec3.to_list(a), Vec3.to_list(b))
  def close?(%Quaternion{} = a, b), do: close?(abs(Quaternion.dot(a, b)), 1.0)

  def close?(%Transform{} = a, b),
    do: close_all?(Transform.to_list(a), Transform.to_list(b), 1.0e-7)

  def close?(%Transform2D{} = a, b),
    do: abs(a.x - b.x) + abs(a.y - b.y) < 1.0e-9 and close?(:math.cos(a.theta - b.theta), 1.0)

  defp close_all?(as, bs, tolerance \\ 1.0e-9) do
    scale = 1 + Enum.max(Enum.map(as ++ bs, &abs/1))
    as |> Enum.zip(bs) |> Enum.all?(fn {a, b} -> abs(a - b) <= tolerance * scale end)
  end
end
