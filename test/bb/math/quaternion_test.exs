defmodule BB.Math.QuaternionTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Math, only: [close?: 2, direction: 0, quaternion: 0, vec3: 0]

  alias BB.Math.{Quaternion, Vec3}

  doctest BB.Math.Euler
  doctest BB.Math.Quaternion
  doctest BB.Math.RotationMatrix

  test "new makes it one long" do
    q = Quaternion.new(0, 0, 3, 4)

    assert {Quaternion.w(q), Quaternion.x(q), Quaternion.y(q), Quaternion.z(q)} ==
             {0.0, 0.0, 0.6, 0.8}

    assert_raise ArgumentError, ~r/four zeros/, fn -> Quaternion.new(0, 0, 0, 0) end
  end

  test "the products of the imaginary units are Hamilton's: i j = k" do
    i = Quaternion.new(0, 1, 0, 0)
    j = Quaternion.new(0, 0, 1, 0)
    assert Quaternion.multiply(i, j) == Quaternion.new(0, 0, 0, 1)
    assert Quaternion.multiply(j, i) == Quaternion.new(0, 0, 0, -1)
  end

  test "a quarter turn about z takes x to y" do
    q = Quaternion.from_axis_angle(Vec3.new(0, 0, 5), :math.pi() / 2)
    assert close?(Quaternion.rotate(q, Vec3.unit_x()), Vec3.unit_y())
  end

  test "an axis without a direction counts as z" do
    about_z = Quaternion.from_axis_angle(Vec3.unit_z(), 1.0)
    assert Quaternion.from_axis_angle(Vec3.zero(), 1.0) == about_z
    assert Quaternion.from_axis_angle(Vec3.new(9.0e-11, 0, 0), 1.0) == about_z
    assert Quaternion.to_axis_angle(Quaternion.identity()) == {Vec3.unit_z(), 0.0}
  end

  test "the angle about an axis is from 0 to a whole turn" do
    q = Quaternion.negate(Quaternion.from_axis_angle(Vec3.unit_x(), 1.0))
    {axis, angle} = Quaternion.to_axis_angle(q)
    assert axis == Vec3.negate(Vec3.unit_x())
    assert close?(angle, 2 * :math.pi() - 1.0)
    {axis, angle} = Quaternion.to_shortest_axis_angle(q)
    assert axis == Vec3.unit_x() and close?(angle, 1.0)
  end

  test "the examples of constructors and of Euler angles" do
    assert rounded(Quaternion.new(1, 2, 3, 4)) ==
             [0.182574186, 0.365148372, 0.547722558, 0.730296743]

    xyz = Quaternion.from_euler(0.1, 0.2, 0.3)
    zyx = Quaternion.from_euler(0.1, 0.2, 0.3, :zyx)
    assert rounded(xyz) == [0.981856173, 0.064071348, 0.091157549, 0.153439302]
    assert rounded(zyx) == [0.983347443, 0.034270799, 0.106020511, 0.143572175]
    assert rounded(Quaternion.to_euler(zyx, :xyz)) == [0.037879881, 0.220124031, 0.285771701]
    assert rounded(Quaternion.to_euler(xyz, :zyx)) == [0.156419513, 0.160027220, 0.322609691]

    assert Enum.map(Quaternion.to_rotation_list(xyz), &rounded/1) == [
             [0.936293364, -0.289629478, 0.198669331],
             [0.312991826, 0.944702486, -0.097843395],
             [-0.159345079, 0.153791998, 0.975170327]
           ]
  end

  test "any order that is not :zyx is :xyz" do
    q = Quaternion.from_euler(0.1, 0.2, 0.3)
    assert Quaternion.from_euler(0.1, 0.2, 0.3, :yxz) == q
    assert Quaternion.to_euler(q, :yxz) == Quaternion.to_euler(q, :xyz)
  end

  test "a pitch of a quarter turn leaves roll at zero" do
    quarter = :math.pi() / 2

    for {order, up, down} <- [{:xyz, 0.7, 0.1}, {:zyx, 0.1, 0.7}] do
      {roll, pitch, yaw} =
        Quaternion.to_euler(Quaternion.from_euler(0.3, quarter, 0.4, order), order)

      assert {roll, pitch} == {0.0, quarter} and close?(yaw, up)

      {roll, pitch, yaw} =
        Quaternion.to_euler(Quaternion.from_euler(0.3, -quarter, 0.4, order), order)

      assert {roll, pitch} == {0.0, -quarter} and close?(yaw, down)
    end
  end

  test "lists have the real part first or, as in ROS, last" do
    q = Quaternion.new(1, 2, 3, 4)
    assert Quaternion.to_list(q) == [q.w, q.x, q.y, q.z]
    assert Quaternion.to_xyzw_list(q) == [q.x, q.y, q.z, q.w]
    assert close?(Quaternion.from_list([1, 2, 3, 4]), q)
    assert close?(Quaternion.from_xyzw_list([2, 3, 4, 1]), q)
  end

  test "inspect shows the call that makes the quaternion, up to the limit" do
    q = Quaternion.identity()
    assert inspect(q) == "BB.Math.Quaternion.new(1.0, 0.0, 0.0, 0.0)"
    assert inspect(q, limit: 2) == "BB.Math.Quaternion.new(1.0, 0.0, ...)"
  end

  test "slerp takes a fraction" do
    q = Quaternion.identity()

    for t <- [-0.1, 1.1],
        do: assert_raise(FunctionClauseError, fn -> Quaternion.slerp(q, q, t) end)
  end

  test "from one vector to the opposite is half a turn about a perpendicular axis" do
    for {axis, expected} <- [
          {Vec3.unit_x(), [0.0, 0.0, 1.0, 0.0]},
          {Vec3.unit_y(), [0.0, -1.0, 0.0, 0.0]},
          {Vec3.unit_z(), [0.0, 1.0, 0.0, 0.0]}
        ] do
      q = Quaternion.from_two_vectors(axis, Vec3.negate(axis))
      assert close?(q, Quaternion.from_list(expected))
    end
  end

  test "the zero vector counts as x" do
    q = Quaternion.from_two_vectors(Vec3.zero(), Vec3.unit_y())
    assert rounded(q) == [0.707106781, 0.0, 0.0, 0.707106781]
    assert Quaternion.from_two_vectors(Vec3.unit_x(), Vec3.zero()) == Quaternion.identity()
  end

  property "from_two_vectors turns one direction into the other" do
    forall {a, b} <- {direction(), direction()} do
      close?(Quaternion.rotate_vector(Quaternion.from_two_vectors(a, b), a), b)
    end
  end

  property "from_two_vectors turns nearly opposite directions, too" do
    forall {a, offset, size} <- {direction(), direction(), float(0.0, 1.0e-2)} do
      b = Vec3.normalise(Vec3.add(Vec3.negate(a), Vec3.scale(offset, size)))
      close?(Quaternion.rotate_vector(Quaternion.from_two_vectors(a, b), a), b)
    end
  end

  property "a rotation matrix leads back to the rotation" do
    forall q <- quaternion() do
      close?(Quaternion.from_rotation_matrix(Quaternion.to_rotation_list(q)), q)
    end
  end

  property "own names mean the same" do
    forall {a, b, v} <- {quaternion(), quaternion(), vec3()} do
      Quaternion.rotate(a, v) == Quaternion.rotate_vector(a, v) and
        Quaternion.angle(a, b) == Quaternion.angular_distance(a, b) and
        Quaternion.normalize(a) == Quaternion.normalise(a)
    end
  end

  property "a rotation keeps lengths" do
    forall {q, v} <- {quaternion(), vec3()} do
      close?(Vec3.norm(Quaternion.rotate(q, v)), Vec3.norm(v))
    end
  end

  property "a rotation keeps angles and handedness" do
    forall {q, a, b} <- {quaternion(), vec3(), vec3()} do
      {ra, rb} = {Quaternion.rotate(q, a), Quaternion.rotate(q, b)}

      abs(Vec3.dot(ra, rb) - Vec3.dot(a, b)) < 1.0e-9 * (1 + Vec3.norm(a) * Vec3.norm(b)) and
        Vec3.distance(Quaternion.rotate(q, Vec3.cross(a, b)), Vec3.cross(ra, rb)) <
          1.0e-9 * (1 + Vec3.norm(a) * Vec3.norm(b))
    end
  end

  property "q · q⁻¹ = 1, and the inverse of a unit quaternion is its conjugate" do
    forall q <- quaternion() do
      close?(Quaternion.multiply(q, Quaternion.inverse(q)), Quaternion.identity()) and
        close?(Quaternion.inverse(q), Quaternion.conjugate(q))
    end
  end

  property "products stay one long and are associative" do
    forall {a, b, c} <- {quaternion(), quaternion(), quaternion()} do
      left = Quaternion.multiply(Quaternion.multiply(a, b), c)

      close?(Quaternion.norm(left), 1.0) and
        close?(left, Quaternion.multiply(a, Quaternion.multiply(b, c)))
    end
  end

  property "a product rotates by its second factor, then by its first" do
    forall {a, b, v} <- {quaternion(), quaternion(), vec3()} do
      close?(
        Quaternion.rotate(Quaternion.multiply(a, b), v),
        Quaternion.rotate(a, Quaternion.rotate(b, v))
      )
    end
  end

  property "the negative is the same rotation" do
    forall {q, v} <- {quaternion(), vec3()} do
      close?(Quaternion.rotate(Quaternion.negate(q), v), Quaternion.rotate(q, v))
    end
  end

  property "axis and angle lead back to the rotation" do
    forall q <- quaternion() do
      {axis, angle} = Quaternion.to_axis_angle(q)
      {short_axis, short_angle} = Quaternion.to_shortest_axis_angle(q)

      angle >= 0 and angle <= 2 * :math.pi() and short_angle >= 0 and
        short_angle <= :math.pi() + 1.0e-12 and
        close?(Quaternion.from_axis_angle(axis, angle), q) and
        close?(Quaternion.from_axis_angle(short_axis, short_angle), q)
    end
  end

  # Near a pitch of a quarter turn, the angles are those of a quarter turn.
  property "Euler angles lead back to the rotation" do
    forall {q, order} <- {quaternion(), oneof([:xyz, :zyx])} do
      {roll, pitch, yaw} = Quaternion.to_euler(q, order)
      back = Quaternion.from_euler(roll, pitch, yaw, order)

      if abs(pitch) < 1.56,
        do: close?(back, q),
        else: Quaternion.angular_distance(back, q) < 0.01
    end
  end

  property "slerp turns at constant speed on the shorter way" do
    forall {a, b, t} <- {quaternion(), quaternion(), float(0.0, 1.0)} do
      whole = Quaternion.angle(a, b)

      abs(Quaternion.angle(a, Quaternion.slerp(a, b, t)) - t * whole) < 1.0e-6 and
        close?(Quaternion.slerp(a, b, 0), a) and close?(Quaternion.slerp(a, b, 1), b)
    end
  end

  defp rounded(%Quaternion{} = q), do: rounded(Quaternion.to_list(q))
  defp rounded(tuple) when is_tuple(tuple), do: rounded(Tuple.to_list(tuple))
  defp rounded(list), do: Enum.map(list, &Float.round(&1 / 1, 9))
end
