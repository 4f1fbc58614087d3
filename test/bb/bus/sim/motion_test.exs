defmodule BB.Bus.Sim.MotionTest do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim.Motion

  doctest BB.Bus.Sim.Motion

  @times for n <- 0..200, do: n * 0.137

  test "gravity is the only acceleration, at any attitude" do
    for t <- @times, do: assert_in_delta(norm(Motion.at(t).acceleration), 9.80665, 1.0e-9)
  end

  test "the rotation is the rate at which gravity turns in the body's frame" do
    step = 1.0e-6

    for t <- @times do
      %{acceleration: up, angular_velocity: rate} = Motion.at(t)
      turned = Motion.at(t + step).acceleration |> minus(up) |> times(1 / step)
      assert_near(turned, cross(up, rate), 1.0e-4)
    end
  end

  test "the body also turns about the vertical" do
    assert Enum.any?(@times, fn t ->
             %{acceleration: up, angular_velocity: rate} = Motion.at(t)
             abs(dot(up, rate)) / 9.80665 > 0.2
           end)
  end

  defp norm(v), do: :math.sqrt(dot(v, v))
  defp dot({a, b, c}, {x, y, z}), do: a * x + b * y + c * z
  defp cross({a, b, c}, {x, y, z}), do: {b * z - c * y, c * x - a * z, a * y - b * x}
  defp minus({a, b, c}, {x, y, z}), do: {a - x, b - y, c - z}
  defp times({a, b, c}, k), do: {a * k, b * k, c * k}

  defp assert_near({a, b, c}, {x, y, z}, delta) do
    for {l, r} <- [{a, x}, {b, y}, {c, z}], do: assert_in_delta(l, r, delta)
  end
end
