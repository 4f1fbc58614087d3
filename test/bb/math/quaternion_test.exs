defmodule BB.Math.QuaternionTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Math, only: [close?: 2, quaternion: 0, vec3: 0]

  alias BB.Math.{Quaternion, Vec3}

  doctest BB.Math.Quaternion

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

  test "a rotation about no axis is none" do
    assert Quaternion.from_axis_angle(Vec3.zero(), 1.0) == Quaternion.identity()
  end

  test "Euler angles turn about the fixed axes: roll, then pitch, then yaw" do
    quarter = :math.pi() / 2
    q = Quaternion.from_euler(quarter, 0, quarter)
    # The roll rotates y to z, and the yaw does not change z.
    assert close?(Quaternion.rotate(q, Vec3.unit_y()), Vec3.unit_z())
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

  property "axis and angle, and Euler angles, lead back to the rotation" do
    forall q <- quaternion() do
      {axis, angle} = Quaternion.to_axis_angle(q)
      {roll, pitch, yaw} = Quaternion.to_euler(q)

      angle >= 0 and angle <= :math.pi() + 1.0e-12 and
        close?(Quaternion.from_axis_angle(axis, angle), q) and
        close?(Quaternion.from_euler(roll, pitch, yaw), q)
    end
  end

  property "slerp turns at constant speed on the shorter way" do
    forall {a, b, t} <- {quaternion(), quaternion(), float(0.0, 1.0)} do
      whole = Quaternion.angle(a, b)

      abs(Quaternion.angle(a, Quaternion.slerp(a, b, t)) - t * whole) < 1.0e-6 and
        close?(Quaternion.slerp(a, b, 0), a) and close?(Quaternion.slerp(a, b, 1), b)
    end
  end
end
