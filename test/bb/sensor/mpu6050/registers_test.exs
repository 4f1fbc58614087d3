defmodule BB.Sensor.Mpu6050.RegistersTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Bus.Sim.Mpu6050, as: Chip
  alias BB.Sensor.Mpu6050.Registers

  doctest BB.Sensor.Mpu6050.Registers

  @g 9.80665
  @degree :math.pi() / 180

  describe "a reading" do
    test "has the datasheet's sensitivity in each range of the accelerometer" do
      for {range, lsb_per_g} <- [{2, 16_384}, {4, 8192}, {8, 4096}, {16, 2048}] do
        reading = Registers.decode(<<lsb_per_g::16, -lsb_per_g::16, 0::80>>, range, 250)
        assert_near(reading.acceleration, {@g, -@g, 0.0})
      end
    end

    test "has the datasheet's sensitivity in each range of the gyroscope" do
      for {range, lsb_per_ten} <- [{250, 1310}, {500, 655}, {1000, 328}, {2000, 164}] do
        reading = Registers.decode(<<0::64, lsb_per_ten::16, 0::16, -lsb_per_ten::16>>, 2, range)
        assert_near(reading.angular_velocity, {10 * @degree, 0.0, -10 * @degree})
      end
    end

    test "has the datasheet's temperature: 36.53 °C at 0 and 340 steps a degree" do
      for {raw, celsius} <- [
            {0, 36.53},
            {340, 37.53},
            {-521, 35.0 - 0.0023529},
            {-12_420, 0.0 + 0.0005882}
          ] do
        reading = Registers.decode(<<0::48, raw::16, 0::48>>, 2, 250)
        assert_in_delta reading.temperature, celsius, 1.0e-6
      end
    end

    test "reaches the whole scale" do
      reading = Registers.decode(<<-32_768::16, 32_767::16, 0::48, -32_768::16, 0::16>>, 16, 2000)
      assert_near(reading.acceleration, {-16 * @g, 16 * @g - @g / 2048, 0.0})
      assert_in_delta elem(reading.angular_velocity, 1), -32_768 / 16.4 * @degree, 1.0e-9
    end

    defp assert_near({a, b, c}, {x, y, z}) do
      for {left, right} <- [{a, x}, {b, y}, {c, z}], do: assert_in_delta(left, right, 1.0e-9)
    end
  end

  describe "one step" do
    test "is the inverse of the sensitivity" do
      assert_in_delta Registers.acceleration_lsb(2), 9.80665 / 16_384, 1.0e-15
      assert_in_delta Registers.angular_velocity_lsb(250), @degree / 131, 1.0e-15
      assert_in_delta Registers.angular_velocity_lsb(2000), @degree / 16.4, 1.0e-15
    end
  end

  # The simulated chip has an implementation of its own.
  property "what the chip encodes is decoded within one step, in every range" do
    forall {afs_sel, fs_sel, acceleration, rate, temperature} <- felt() do
      accel_range = Enum.at(Registers.accel_ranges(), afs_sel)
      gyro_range = Enum.at(Registers.gyro_ranges(), fs_sel)
      sample = %{acceleration: acceleration, angular_velocity: rate, temperature: temperature}

      reading =
        sample |> Chip.encode(afs_sel, fs_sel) |> Registers.decode(accel_range, gyro_range)

      near?(reading.acceleration, acceleration, Registers.acceleration_lsb(accel_range)) and
        near?(reading.angular_velocity, rate, Registers.angular_velocity_lsb(gyro_range)) and
        abs(reading.temperature - temperature) <= 1 / 340
    end
  end

  # Anything within the chosen ranges; with the datasheet's rounded 16.4 LSB/(°/s) 16 bits end at
  # 1998 °/s.
  defp felt do
    bind({integer(0, 3), integer(0, 3)}, fn {afs_sel, fs_sel} ->
      accel = Enum.at([2, 4, 8, 16], afs_sel) * @g * 0.999
      rate = Enum.at([250, 500, 1000, 2000], fs_sel) * @degree * 0.998

      {afs_sel, fs_sel, {float(-accel, accel), float(-accel, accel), float(-accel, accel)},
       {float(-rate, rate), float(-rate, rate), float(-rate, rate)}, float(-40.0, 85.0)}
    end)
  end

  defp near?({a, b, c}, {x, y, z}, step),
    do: Enum.all?([a - x, b - y, c - z], &(abs(&1) <= step))

  describe "the divider" do
    test "is 1 + n of 1 kHz with the filter and of 8 kHz without" do
      for {rate, filter, divider} <- [
            {1000, 184, 0},
            {500, 184, 1},
            {200, 94, 4},
            {100, 44, 9},
            {50, 20, 19},
            {4, 5, 249},
            {1000, 260, 7},
            {500, 260, 15},
            {100, 260, 79}
          ] do
        assert Registers.divider(rate, filter) == divider
        assert Registers.sample_rate_hz(divider, filter) == rate * 1.0
      end
    end

    test "ends at 255" do
      assert Registers.divider(4, 260) == 255
      assert Registers.sample_rate_hz(255, 44) == 3.90625
    end
  end

  property "the chip is never slower than asked, and not faster than it must be" do
    forall {rate, filter} <- {float(4.0, 1000.0), oneof(Registers.filters())} do
      divider = Registers.divider(rate, filter)
      slower? = divider < 255 and Registers.sample_rate_hz(divider + 1, filter) >= rate
      Registers.sample_rate_hz(divider, filter) >= rate and not slower?
    end
  end

  describe "settings" do
    test "have the datasheet's bits" do
      settings = %{divider: 0, filter: 260, gyro_range: 250, accel_range: 2}
      assert Registers.encode_settings(settings) == <<0, 0, 0, 0>>

      for {filter, code} <- [{184, 1}, {94, 2}, {44, 3}, {20, 4}, {10, 5}, {5, 6}],
          do: assert(<<0, ^code, 0, 0>> = Registers.encode_settings(%{settings | filter: filter}))

      for {range, byte} <- [{500, 0x08}, {1000, 0x10}, {2000, 0x18}],
          do:
            assert(
              <<0, 0, ^byte, 0>> = Registers.encode_settings(%{settings | gyro_range: range})
            )

      for {range, byte} <- [{4, 0x08}, {8, 0x10}, {16, 0x18}],
          do:
            assert(
              <<0, 0, 0, ^byte>> = Registers.encode_settings(%{settings | accel_range: range})
            )
    end

    test "with bits that are never set here are not understood" do
      for bytes <- [
            <<0, 7, 0, 0>>,
            <<0, 0x08, 0, 0>>,
            <<0, 0, 0x80, 0>>,
            <<0, 0, 0, 0x20>>,
            <<0, 0, 0, 1>>
          ],
          do: assert(Registers.decode_settings(bytes) == :error)
    end
  end

  property "settings come back from their bytes" do
    generator =
      {integer(0, 255), oneof(Registers.filters()), oneof(Registers.gyro_ranges()),
       oneof(Registers.accel_ranges())}

    forall {divider, filter, gyro_range, accel_range} <- generator do
      settings = %{
        divider: divider,
        filter: filter,
        gyro_range: gyro_range,
        accel_range: accel_range
      }

      settings |> Registers.encode_settings() |> Registers.decode_settings() == {:ok, settings}
    end
  end
end
