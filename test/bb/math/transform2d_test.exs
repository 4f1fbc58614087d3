defmodule BB.Math.Transform2DTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Math, only: [close?: 2, coordinate: 0, direction: 0, transform2d: 0, vec3: 0]

  alias BB.Math.{Transform, Transform2D, Vec3}

  doctest BB.Math.Transform2D

  test "the angle counts turns" do
    t = Transform2D.new(0, 0, 3.0)
    assert Transform2D.compose(t, t).theta == 6.0
    assert Transform2D.inverse(Transform2D.new(0, 0, 4.0)).theta == -4.0
  end

  test "the examples of composition and inverse" do
    t = Transform2D.compose(Transform2D.new(1, 2, :math.pi() / 2), Transform2D.new(1, 0, 0.5))
    assert {Float.round(t.x, 9), Float.round(t.y, 9)} == {1.0, 3.0}
    assert Float.round(t.theta, 9) == 2.070796327
    t = Transform2D.inverse(Transform2D.new(1, 2, :math.pi() / 2))
    assert {Float.round(t.x, 9), Float.round(t.y, 9), t.theta} == {-2.0, 1.0, -:math.pi() / 2}
  end

  property "a wrapped angle is within a turn" do
    forall theta <- coordinate() do
      wrapped = Transform2D.wrap(Transform2D.new(1, 2, theta))

      abs(wrapped.theta) <= :math.pi() and {wrapped.x, wrapped.y} == {1.0, 2.0} and
        close?(:math.cos(wrapped.theta), :math.cos(theta)) and
        close?(:math.sin(wrapped.theta), :math.sin(theta))
    end
  end

  test "the basis of a plane" do
    minus_z = Vec3.negate(Vec3.unit_z())

    for {normal, u, v} <- [
          {Vec3.unit_z(), [1, 0, 0], [0, 1, 0]},
          {Vec3.unit_x(), [0, 1, 0], [0, 0, 1]},
          {Vec3.unit_y(), [-1, 0, 0], [0, 0, 1]},
          {minus_z, [-1, 0, 0], [0, 1, 0]},
          {Vec3.new(1, 1, 1), [-0.7071, 0.7071, 0], [-0.4082, -0.4082, 0.8165]}
        ] do
      {got_u, got_v} = Transform2D.plane_basis(normal)
      assert Vec3.distance(got_u, Vec3.from_list(u)) < 1.0e-4
      assert Vec3.distance(got_v, Vec3.from_list(v)) < 1.0e-4
    end
  end

  property "the basis of a plane is right-handed, with its normal" do
    forall normal <- vec3() do
      {u, v} = Transform2D.plane_basis(normal)

      Vec3.magnitude(normal) < 1.0e-6 or
        (close?(Vec3.cross(u, v), Vec3.normalise(normal)) and
           close?(Vec3.magnitude(u), 1.0) and close?(Vec3.magnitude(v), 1.0))
    end
  end

  property "lifting agrees with composition and inverse" do
    forall {a, b, normal} <- {transform2d(), transform2d(), direction()} do
      close?(
        Transform2D.to_transform(Transform2D.compose(a, b), normal),
        Transform.compose(
          Transform2D.to_transform(a, normal),
          Transform2D.to_transform(b, normal)
        )
      ) and
        close?(
          Transform2D.to_transform(Transform2D.inverse(a), normal),
          Transform.inverse(Transform2D.to_transform(a, normal))
        )
    end
  end

  property "composition is associative, with identity as its unit" do
    forall {a, b, c} <- {transform2d(), transform2d(), transform2d()} do
      close?(
        Transform2D.compose(Transform2D.compose(a, b), c),
        Transform2D.compose(a, Transform2D.compose(b, c))
      ) and close?(Transform2D.compose(a, Transform2D.identity()), a)
    end
  end

  property "the inverse undoes the motion" do
    forall t <- transform2d() do
      close?(Transform2D.compose(t, Transform2D.inverse(t)), Transform2D.identity()) and
        close?(Transform2D.compose(Transform2D.inverse(t), t), Transform2D.identity())
    end
  end
end
