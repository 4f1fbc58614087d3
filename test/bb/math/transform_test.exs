defmodule BB.Math.TransformTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Math, only: [close?: 2, quaternion: 0, transform: 0, vec3: 0]

  alias BB.Math.{Quaternion, Transform, Vec3}

  doctest BB.Math.Transform

  test "the matrix is kept row by row" do
    assert Transform.translation(Vec3.new(1, 2, 3)).m ==
             {1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0}

    assert Transform.at(Transform.translation(Vec3.new(1, 2, 3)), 1, 3) == 2.0
  end

  test "from_list takes sixteen numbers, the last row 0, 0, 0, 1" do
    list = [1, 0, 0, 4, 0, 1, 0, 5, 0, 0, 1, 6, 0, 0, 0, 1]
    assert Transform.from_list(list) == Transform.translation(Vec3.new(4, 5, 6))

    assert_raise ArgumentError, ~r/expected a list of 16 numbers/, fn ->
      Transform.from_list(tl(list))
    end

    assert_raise ArgumentError, ~r/last row/, fn ->
      Transform.from_list(List.replace_at(list, 15, 2))
    end
  end

  test "own names mean the same" do
    {t, v} = {Transform.rotation_x(0.3), Vec3.new(1, 2, 3)}
    q = Quaternion.from_axis_angle(Vec3.unit_x(), 0.3)
    assert Transform.apply_point(t, v) == Transform.apply_to_point(t, v)
    assert Transform.from_translation(v) == Transform.translation(v)
    assert Transform.from_rotation(q) == Transform.from_quaternion(q)
    assert close?(Transform.from_quaternion(q), t)
  end

  test "an origin rotates first; its translation is in the rotated frame" do
    assert Transform.from_origin(nil) == Transform.identity()
    origin = %{position: {1, 2, 3}, orientation: {0.0, 0.0, :math.pi() / 2}}
    moved = Transform.get_translation(Transform.from_origin(origin))
    assert close?(moved, Vec3.new(-2, 1, 3))

    turned = Transform.from_origin(%{position: {0, 0, 0}, orientation: {0.1, 0.2, 0.3}})
    assert close?(Transform.get_quaternion(turned), Quaternion.from_euler(0.1, 0.2, 0.3))
  end

  test "the examples of composition" do
    quarter = Transform.rotation_z(:math.pi() / 2)
    step = Transform.translation(Vec3.unit_x())
    apply = &Transform.apply_to_point(&1, Vec3.unit_x())
    assert close?(apply.(Transform.compose(step, quarter)), Vec3.new(1, 1, 0))
    assert close?(apply.(Transform.compose(quarter, step)), Vec3.new(0, 2, 0))
    assert Transform.compose_all([]) == Transform.identity()
    assert close?(apply.(Transform.compose_all([step, quarter])), Vec3.new(1, 1, 0))
  end

  test "the axis of from_axis_angle is not normalised" do
    doubled = Transform.from_axis_angle(Vec3.new(0, 0, 2), 1.0)
    refute close?(doubled, Transform.rotation_z(1.0))
    assert close?(Transform.from_axis_angle(Vec3.unit_z(), 1.0), Transform.rotation_z(1.0))
  end

  test "the columns of the rotation are the rotated axes" do
    t = Transform.compose(Transform.rotation_z(0.4), Transform.rotation_y(0.7))
    assert Transform.get_right_vector(t) == Transform.apply_vector(t, Vec3.unit_x())
    assert Transform.get_up_vector(t) == Transform.apply_vector(t, Vec3.unit_y())
    assert Transform.get_forward_vector(t) == Transform.apply_vector(t, Vec3.unit_z())
  end

  test "inspect shows the struct" do
    assert inspect(Transform.identity()) =~ ~r/\A%BB.Math.Transform\{m: \{1.0, 0.0/
  end

  property "rotation and translation come out as they went in" do
    forall {q, v} <- {quaternion(), vec3()} do
      t = Transform.new(q, v)

      close?(Transform.get_quaternion(t), q) and Transform.get_translation(t) == v and
        Transform.translation(t) == v and Transform.rotation(t) == Transform.get_quaternion(t)
    end
  end

  property "points are turned, then moved; directions are turned" do
    forall {q, v, p} <- {quaternion(), vec3(), vec3()} do
      t = Transform.new(q, v)
      turned = Quaternion.rotate_vector(q, p)

      close?(Transform.apply_to_point(t, p), Vec3.add(turned, v)) and
        close?(Transform.apply_vector(t, p), turned)
    end
  end

  property "a composition moves by its second motion, then by its first" do
    forall {a, b, p} <- {transform(), transform(), vec3()} do
      close?(
        Transform.apply_to_point(Transform.compose(a, b), p),
        Transform.apply_to_point(a, Transform.apply_to_point(b, p))
      )
    end
  end

  property "composition is associative, with identity as its unit" do
    forall {a, b, c} <- {transform(), transform(), transform()} do
      close?(
        Transform.compose(Transform.compose(a, b), c),
        Transform.compose(a, Transform.compose(b, c))
      ) and
        close?(Transform.compose(a, Transform.identity()), a) and
        close?(Transform.compose(Transform.identity(), a), a)
    end
  end

  property "the inverse undoes the motion" do
    forall {t, p} <- {transform(), vec3()} do
      close?(Transform.compose(t, Transform.inverse(t)), Transform.identity()) and
        close?(Transform.apply_to_point(Transform.inverse(t), Transform.apply_to_point(t, p)), p)
    end
  end
end
