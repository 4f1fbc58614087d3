defmodule BB.Math.TransformTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Math, only: [close?: 2, quaternion: 0, transform: 0, vec3: 0]

  alias BB.Math.{Quaternion, Transform, Vec3}

  doctest BB.Math.Transform

  test "the matrix is kept row by row" do
    assert Transform.from_translation(Vec3.new(1, 2, 3)).m ==
             {1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0}

    assert Transform.at(Transform.from_translation(Vec3.new(1, 2, 3)), 1, 3) == 2.0
  end

  test "from_list takes sixteen numbers, the last row 0, 0, 0, 1" do
    list = [1, 0, 0, 4, 0, 1, 0, 5, 0, 0, 1, 6, 0, 0, 0, 1]
    assert Transform.from_list(list) == Transform.from_translation(Vec3.new(4, 5, 6))

    assert_raise ArgumentError, ~r/expected a list of 16 numbers/, fn ->
      Transform.from_list(tl(list))
    end

    assert_raise ArgumentError, ~r/last row/, fn ->
      Transform.from_list(List.replace_at(list, 15, 2))
    end
  end

  property "rotation and translation come out as they went in" do
    forall {q, v} <- {quaternion(), vec3()} do
      t = Transform.new(q, v)
      close?(Transform.rotation(t), q) and Transform.translation(t) == v
    end
  end

  property "points are turned, then moved; directions are turned" do
    forall {q, v, p} <- {quaternion(), vec3(), vec3()} do
      t = Transform.new(q, v)
      turned = Quaternion.rotate(q, p)

      close?(Transform.apply_point(t, p), Vec3.add(turned, v)) and
        close?(Transform.apply_vector(t, p), turned)
    end
  end

  property "a composition moves by its second motion, then by its first" do
    forall {a, b, p} <- {transform(), transform(), vec3()} do
      close?(
        Transform.apply_point(Transform.compose(a, b), p),
        Transform.apply_point(a, Transform.apply_point(b, p))
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
        close?(Transform.apply_point(Transform.inverse(t), Transform.apply_point(t, p)), p)
    end
  end
end
