defmodule BB.Math.Vec3Test do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Math, only: [close?: 2, coordinate: 0, vec3: 0]

  alias BB.Math.Vec3

  doctest BB.Math.Vec3

  test "elements are floats, whatever numbers they are made of" do
    v = Vec3.new(1, 2, 3)
    assert {Vec3.x(v), Vec3.y(v), Vec3.z(v)} === {1.0, 2.0, 3.0}
    assert Vec3.from_list(Vec3.to_list(v)) === v
  end

  test "the zero vector has no direction" do
    assert Vec3.normalize(Vec3.zero()) == Vec3.zero()
    assert Vec3.normalise(Vec3.zero()) == Vec3.zero()
    assert Vec3.normalise(Vec3.new(9.0e-11, 0, 0)) == Vec3.zero()
    assert Vec3.normalise(Vec3.new(2.0e-10, 0, 0)) == Vec3.unit_x()
    assert Vec3.perpendicular(Vec3.zero()) == Vec3.unit_x()
  end

  test "inspect shows the call that makes the vector, up to the limit" do
    assert inspect(Vec3.new(1, 2, 3)) == "BB.Math.Vec3.new(1.0, 2.0, 3.0)"
    assert inspect(Vec3.new(1, 2, 3), limit: 2) == "BB.Math.Vec3.new(1.0, 2.0, ...)"
  end

  test "the linear interpolation is exact at its ends, and goes on behind them" do
    {a, b} = {Vec3.new(0.1, 0.2, 0.3), Vec3.new(1.0e9, -7.7, 0.7)}
    assert Vec3.lerp(a, b, 0) == a
    assert Vec3.lerp(a, b, 1) == b
    assert Vec3.lerp(Vec3.zero(), Vec3.unit_x(), 2) == Vec3.new(2, 0, 0)
  end

  property "perpendicular is one long and stands on the vector" do
    forall v <- vec3() do
      p = Vec3.perpendicular(v)
      close?(Vec3.magnitude(p), 1.0) and abs(Vec3.dot(p, v)) <= 1.0e-9 * (1 + Vec3.magnitude(v))
    end
  end

  property "a normalised vector is one long" do
    forall v <- vec3() do
      Vec3.norm(v) == 0 or
        (close?(Vec3.norm(Vec3.normalize(v)), 1.0) and
           (Vec3.norm(v) < 1.0e-10 or close?(Vec3.normalise(v), Vec3.normalize(v))))
    end
  end

  property "the vector product stands on both" do
    forall {a, b} <- {vec3(), vec3()} do
      cross = Vec3.cross(a, b)
      scale = Vec3.norm(a) * Vec3.norm(b) * (Vec3.norm(a) + Vec3.norm(b)) + 1
      abs(Vec3.dot(cross, a)) + abs(Vec3.dot(cross, b)) < 1.0e-9 * scale
    end
  end

  property "the products fit together: |a × b|² + (a · b)² = |a|²|b|²" do
    forall {a, b} <- {vec3(), vec3()} do
      close?(
        Vec3.norm_squared(Vec3.cross(a, b)) + Vec3.dot(a, b) ** 2,
        Vec3.norm_squared(a) * Vec3.norm_squared(b)
      )
    end
  end

  property "no side of a triangle is longer than the others" do
    forall {a, b, c} <- {vec3(), vec3(), vec3()} do
      Vec3.distance(a, c) <= Vec3.distance(a, b) + Vec3.distance(b, c) + 1.0e-9
    end
  end

  property "subtracting undoes adding, and lerp goes from one to the other" do
    forall {a, b, t} <- {vec3(), vec3(), coordinate()} do
      close?(Vec3.subtract(Vec3.add(a, b), b), a) and close?(Vec3.lerp(a, b, 0), a) and
        close?(Vec3.lerp(a, b, 1), b) and close?(Vec3.lerp(a, b, t), Vec3.lerp(b, a, 1 - t))
    end
  end
end
