defmodule BB.Math.ReferenceTest do
  @moduledoc """
  Holds BB.Math to the values of numpy and scipy in test/support/math/reference.terms, which
  `bin/test python` computes again.
  """

  use ExUnit.Case, async: true

  alias BB.Math.{Covariance3, Quaternion, Transform, Transform2D, Vec3}

  @file_of_cases Path.expand("../../support/math/reference.terms", __DIR__)
  @external_resource @file_of_cases

  {:ok, cases} = :file.consult(@file_of_cases)
  @functions cases |> Enum.map(&elem(&1, 0)) |> Enum.uniq()

  test "covers the functions that compute" do
    assert length(@functions) == 43
  end

  for function <- @functions do
    test "#{function} has the values of numpy or scipy" do
      cases = for {unquote(function), arguments, result} <- cases(), do: {arguments, result}
      assert length(cases) >= 10

      for {arguments, expected} <- cases do
        result = apply(__MODULE__, unquote(function), arguments)
        assert close?(result, expected), difference(arguments, result, expected)
      end
    end
  end

  defp cases do
    {:ok, cases} = :file.consult(@file_of_cases)
    cases
  end

  defp difference(arguments, result, expected),
    do: "expected #{inspect(expected)} for #{inspect(arguments)}, got: #{inspect(result)}"

  # The direction of a quaternion counts, but not its sign.
  defp close?({:rotation, result}, expected),
    do: near?(result, expected) or near?(Enum.map(result, &(-&1)), expected)

  defp close?(result, expected), do: near?(result, expected)

  defp near?(result, expected) do
    {result, expected} = {List.flatten([result]), List.flatten([expected])}

    length(result) == length(expected) and
      Enum.zip(result, expected)
      |> Enum.all?(fn {a, b} -> is_float(a) and abs(a - b) <= 1.0e-10 * (1 + abs(b)) end)
  end

  def vec3_add(a, b), do: list(Vec3.add(v(a), v(b)))
  def vec3_subtract(a, b), do: list(Vec3.subtract(v(a), v(b)))
  def vec3_scale(a, factor), do: list(Vec3.scale(v(a), factor))
  def vec3_dot(a, b), do: Vec3.dot(v(a), v(b))
  def vec3_cross(a, b), do: list(Vec3.cross(v(a), v(b)))
  def vec3_magnitude(a), do: Vec3.magnitude(v(a))
  def vec3_magnitude_squared(a), do: Vec3.magnitude_squared(v(a))
  def vec3_normalise(a), do: list(Vec3.normalise(v(a)))
  def vec3_distance(a, b), do: Vec3.distance(v(a), v(b))
  def vec3_lerp(a, b, t), do: list(Vec3.lerp(v(a), v(b), t))

  def quaternion_new([w, x, y, z]), do: Quaternion.to_list(Quaternion.new(w, x, y, z))
  def quaternion_multiply(a, b), do: Quaternion.to_list(Quaternion.multiply(q(a), q(b)))
  def quaternion_inverse(a), do: rotation(Quaternion.inverse(q(a)))

  def quaternion_from_axis_angle(axis, angle),
    do: Quaternion.to_list(Quaternion.from_axis_angle(v(axis), angle))

  def quaternion_to_axis_angle(a) do
    {axis, angle} = Quaternion.to_axis_angle(q(a))
    [list(axis), angle]
  end

  def quaternion_from_euler_xyz(roll, pitch, yaw) do
    assert Quaternion.from_euler(roll, pitch, yaw) ==
             Quaternion.from_euler(roll, pitch, yaw, :xyz)

    rotation(Quaternion.from_euler(roll, pitch, yaw))
  end

  def quaternion_from_euler_zyx(roll, pitch, yaw),
    do: rotation(Quaternion.from_euler(roll, pitch, yaw, :zyx))

  def quaternion_to_euler_xyz(a) do
    assert Quaternion.to_euler(q(a)) == Quaternion.to_euler(q(a), :xyz)
    a |> q() |> Quaternion.to_euler() |> Tuple.to_list()
  end

  def quaternion_to_euler_zyx(a), do: a |> q() |> Quaternion.to_euler(:zyx) |> Tuple.to_list()
  def quaternion_from_two_vectors(a, b), do: rotation(Quaternion.from_two_vectors(v(a), v(b)))
  def quaternion_from_rotation_matrix(rows), do: rotation(Quaternion.from_rotation_matrix(rows))
  def quaternion_to_rotation_list(a), do: Quaternion.to_rotation_list(q(a))
  def quaternion_rotate_vector(a, b), do: list(Quaternion.rotate_vector(q(a), v(b)))
  def quaternion_angular_distance(a, b), do: Quaternion.angular_distance(q(a), q(b))
  def quaternion_power(a, factor), do: rotation(Quaternion.power(q(a), factor))
  def quaternion_slerp(a, b, t), do: rotation(Quaternion.slerp(q(a), q(b), t))

  def transform_compose(a, b), do: rows(Transform.compose(t(a), t(b)))

  def transform_compose_all(a, b, c, d),
    do: [a, b, c, d] |> Enum.map(&t/1) |> Transform.compose_all() |> rows()

  def transform_inverse(a), do: rows(Transform.inverse(t(a)))
  def transform_from_axis_angle(axis, angle), do: rows(Transform.from_axis_angle(v(axis), angle))
  def transform_rotation_x(angle), do: rows(Transform.rotation_x(angle))
  def transform_rotation_y(angle), do: rows(Transform.rotation_y(angle))
  def transform_rotation_z(angle), do: rows(Transform.rotation_z(angle))

  def transform_translation_along(axis, distance),
    do: rows(Transform.translation_along(v(axis), distance))

  def transform_from_position_quaternion(position, rotation) do
    transform = Transform.from_position_quaternion(v(position), q(rotation))
    assert transform == Transform.new(q(rotation), v(position))
    assert list(Transform.get_translation(transform)) == position
    rows(transform)
  end

  def transform_get_quaternion(a), do: rotation(Transform.get_quaternion(t(a)))
  def transform_apply_to_point(a, b), do: list(Transform.apply_to_point(t(a), v(b)))

  def transform_from_origin(position, orientation) do
    origin = %{position: List.to_tuple(position), orientation: List.to_tuple(orientation)}
    rows(Transform.from_origin(origin))
  end

  def transform2d_compose(a, b), do: plane(Transform2D.compose(p(a), p(b)))
  def transform2d_inverse(a), do: plane(Transform2D.inverse(p(a)))

  def transform2d_plane_basis(normal) do
    {u, v} = Transform2D.plane_basis(v(normal))
    [list(u), list(v)]
  end

  def transform2d_to_transform(x, y, theta, normal),
    do: rows(Transform2D.to_transform(Transform2D.new(x, y, theta), v(normal)))

  def covariance3_rotate(covariance, rotation) do
    covariance
    |> Covariance3.new()
    |> Covariance3.rotate(q(rotation))
    |> Covariance3.to_list()
  end

  defp v(list), do: Vec3.from_list(list)
  defp q(list), do: Quaternion.from_list(list)
  defp t(rows), do: rows |> Enum.concat() |> Transform.from_list()
  defp p([x, y, theta]), do: Transform2D.new(x, y, theta)

  defp list(vector), do: Vec3.to_list(vector)
  defp rotation(quaternion), do: {:rotation, Quaternion.to_list(quaternion)}
  defp rows(transform), do: transform |> Transform.to_list() |> Enum.chunk_every(4)
  defp plane(transform), do: [transform.x, transform.y, transform.theta]
end
