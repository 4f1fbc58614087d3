defmodule BB.Sensor.HcSr04.EchoTest do
  use ExUnit.Case, async: true

  alias BB.Sensor.HcSr04.Echo

  doctest Echo

  @limits {0.02, 4.0}

  test "is high level time × velocity (340 m/s) / 2, or µs / 58 in cm, as the datasheet has it" do
    assert_in_delta Echo.distance(10_000_000, 340.0), 1.7, 1.0e-9

    for centimetres <- [2, 10, 100, 400] do
      width_ns = centimetres * 58 * 1000
      assert_in_delta Echo.distance(width_ns, 344.8), centimetres / 100, 0.0001 * centimetres
    end
  end

  test "is measured from 2 cm to 400 cm, beyond which there is nothing" do
    assert_in_delta Echo.range(117_000, 343.2, @limits), 0.02, 0.0001
    assert_in_delta Echo.range(23_300_000, 343.2, @limits), 4.0, 0.01
    assert Echo.range(23_400_000, 343.2, @limits) == :infinity
    assert Echo.range(38_000_000, 343.2, @limits) == :infinity
  end

  test "of less than 2 cm is no echo" do
    assert Echo.range(100_000, 343.2, @limits) == :too_short
    assert Echo.range(0, 343.2, @limits) == :too_short
  end
end
