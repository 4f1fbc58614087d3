defmodule BB.Bus.Sim.Mpu6050Test do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim.{Motion, Mpu6050, Recording}

  doctest BB.Bus.Sim.Mpu6050
  doctest BB.Bus.Sim.Mpu6050.Model
  doctest BB.Bus.Sim.Mpu6050.Source

  @ms 1_000_000
  @wake <<0x6B, 0x01>>
  @g 9.80665

  # The chip is pure: the test plays the bus and the clock.

  defp chip(opts \\ []) do
    {:ok, chip} = Mpu6050.init(opts, 0)
    chip
  end

  defp write(chip, bytes, at_ms \\ 0) do
    {:ok, chip} = Mpu6050.write(bytes, round(at_ms * @ms), chip)
    chip
  end

  defp read(chip, register, count, at_ms \\ 0) do
    {:ok, bytes, chip} = Mpu6050.read(count, round(at_ms * @ms), write(chip, <<register>>, at_ms))
    {bytes, chip}
  end

  defp peek(chip, register, at_ms \\ 0) do
    {<<byte>>, _} = read(chip, register, 1, at_ms)
    byte
  end

  defp still(acceleration, rate \\ {0.0, 0.0, 0.0}, temperature \\ 36.53),
    do: %{acceleration: acceleration, angular_velocity: rate, temperature: temperature}

  # Feels the milliseconds since power-on as acceleration in x: one step of the ±16 g range a
  # millisecond.
  defp ruler(seconds), do: still({seconds * 1000 * @g / 2048, 0.0, 0.0})

  defp shown(chip, at_ms) do
    {<<x::signed-16>>, chip} = read(chip, 0x3B, 2, at_ms)
    {x, chip}
  end

  describe "after power-on" do
    test "all registers are 0 but PWR_MGMT_1 (0x40) and WHO_AM_I (0x68)" do
      {bytes, _} = read(chip(), 0x00, 128)

      assert for(
               {byte, address} <- Enum.with_index(:binary.bin_to_list(bytes)),
               byte != 0,
               do: {address, byte}
             ) ==
               [{0x6B, 0x40}, {0x75, 0x68}]
    end

    test "it sleeps: no data come, ever" do
      assert {<<0::14*8>>, chip} = read(chip(), 0x3B, 14, 1000)
      assert peek(chip, 0x3A, 1000) == 0
    end
  end

  describe "registers" do
    test "follow one another when written and when read" do
      chip = write(chip(), <<0x19, 9, 3, 0x08, 0x10>>)
      assert {<<9, 3, 0x08, 0x10>>, chip} = read(chip, 0x19, 4)
      {:ok, next, _} = Mpu6050.read(1, 0, chip)
      assert next == <<0>>
    end

    test "for reading only are not written" do
      chip = write(chip(), <<0x75, 0>>) |> write(<<0x3A, 1>>) |> write(<<0x3B, 1, 2>>)
      assert peek(chip, 0x75) == 0x68
      assert {<<0, 0, 0>>, _} = read(chip, 0x3A, 3)
    end

    test "past the last one read 0" do
      assert {<<0, 0, 0>>, _} = read(chip(), 0x7E, 3)
    end

    test "identify the chip as its options set it" do
      assert peek(chip(who_am_i: 0x70), 0x75) == 0x70
    end
  end

  describe "a reset" do
    test "forgets everything and sends the chip to sleep" do
      chip = chip() |> write(@wake) |> write(<<0x19, 9, 3>>) |> write(<<0x6B, 0x80>>)
      assert {<<0, 0>>, chip} = read(chip, 0x19, 2, 30)
      assert peek(chip, 0x6B, 30) == 0x40
      assert {<<0::14*8>>, _} = read(chip, 0x3B, 14, 60)
    end

    test "takes its time, during which its bit is set and writes are lost" do
      chip = chip() |> write(<<0x6B, 0x80>>) |> write(@wake, 10)
      assert peek(chip, 0x6B, 19) == 0xC0
      assert peek(chip, 0x6B, 20) == 0x40
      assert chip |> write(@wake, 21) |> peek(0x6B, 21) == 0x01
    end
  end

  describe "samples" do
    test "come at 8 kHz without the filter and at 1 kHz with it, divided" do
      for {filter, divider, period_ms} <- [
            {0, 0, 0.125},
            {7, 7, 1.0},
            {1, 0, 1.0},
            {6, 9, 10.0},
            {3, 255, 256.0}
          ] do
        chip = chip(source: &ruler/1) |> write(<<0x1C, 0x18>>) |> write(<<0x19, divider, filter>>)
        chip = write(chip, @wake)
        assert peek(chip, 0x3A, period_ms - 0.01) == 0
        assert peek(chip, 0x3A, period_ms) == 1
      end
    end

    test "follow the chip's own rate, not the time of reading" do
      chip = chip(source: &ruler/1) |> write(<<0x19, 9, 1, 0, 0x18>>) |> write(@wake, 100)
      assert {0, chip} = shown(chip, 109.9)
      assert {110, chip} = shown(chip, 110)
      assert {110, chip} = shown(chip, 119.9)
      assert {150, _chip} = shown(chip, 157)
    end

    test "set the data-ready flag, which reading clears" do
      chip = chip() |> write(<<0x19, 9, 1>>) |> write(@wake)
      {<<1>>, chip} = read(chip, 0x3A, 1, 10)
      {<<0>>, chip} = read(chip, 0x3A, 1, 19)
      {<<1>>, chip} = read(chip, 0x3A, 1, 20)
      {_, chip} = read(chip, 0x3B, 14, 30)
      assert peek(chip, 0x3A, 30) == 1
      {_, chip} = chip |> write(<<0x37, 0x10>>) |> read(0x3B, 14, 40)
      assert peek(chip, 0x3A, 40) == 0
    end

    test "stand still while the chip sleeps or has no clock" do
      for stop <- [0x41, 0x07] do
        chip = chip(source: &ruler/1) |> write(<<0x19, 9, 1, 0, 0x18>>) |> write(@wake)
        chip = write(chip, <<0x6B, stop>>, 25)
        assert {20, chip} = shown(chip, 500)
        chip = write(chip, @wake, 500)
        assert {20, chip} = shown(chip, 509)
        assert {510, _} = shown(chip, 510)
      end
    end

    test "taken before a change of range are not changed by it" do
      chip = chip(source: &ruler/1) |> write(<<0x19, 9, 1, 0, 0x18>>) |> write(@wake)
      chip = write(chip, <<0x1C, 0x00>>, 10)
      assert {10, chip} = shown(chip, 15)
      assert {160, _} = shown(chip, 20)
    end
  end

  describe "the FIFO" do
    # On, with all of a sample, sampling at 1 kHz.
    defp filling(opts \\ []) do
      chip([source: &ruler/1] ++ opts)
      |> write(<<0x19, 0, 1, 0, 0x18>>)
      |> write(<<0x23, 0xF8>>)
      |> write(<<0x6A, 0x40>>)
      |> write(@wake)
    end

    defp fifo_count(chip, at_ms) do
      {<<count::16>>, _} = read(chip, 0x72, 2, at_ms)
      count
    end

    test "takes every sample, also those between two reads" do
      chip = filling()
      assert fifo_count(chip, 3.5) == 3 * 14
      {bytes, chip} = read(chip, 0x74, 3 * 14, 3.5)
      assert for(<<x::signed-16, _::96 <- bytes>>, do: x) == [1, 2, 3]
      assert fifo_count(chip, 4) == 14
      assert {<<4::16, _::96, 0xFF>>, _} = read(chip, 0x74, 15, 4)
    end

    test "takes the selected parts, in the order of the data registers" do
      for {enabled, size} <- [{0x08, 6}, {0x80, 2}, {0x40, 2}, {0x70, 6}, {0x88, 8}, {0, 0}] do
        chip = filling() |> write(<<0x23, enabled>>)
        assert fifo_count(chip, 1) == size
      end
    end

    test "loses the oldest bytes when it overflows, and sets its flag once" do
      for {model, size} <- [mpu6050: 1024, mpu6500: 512, mpu9250: 512] do
        chip = filling(model: model)
        full = div(size, 14)
        assert {<<0x01>>, chip} = read(chip, 0x3A, 1, full)
        assert {<<0x11>>, chip} = read(chip, 0x3A, 1, full + 1)
        assert peek(chip, 0x3A, full + 1) == 0
        assert fifo_count(chip, 10_000) == size
        {bytes, _} = read(chip, 0x74, size, 2000)
        assert <<1999::16, _::96, 2000::16, _::96>> = binary_part(bytes, size, -28)
      end
    end

    test "is emptied by a reset, while it is off only" do
      chip = filling()
      assert chip |> write(<<0x6A, 0x44>>, 5) |> fifo_count(5) == 5 * 14
      assert chip |> write(<<0x6A, 0x04>>, 5) |> fifo_count(9) == 0
    end
  end

  describe "the interrupt pin" do
    @line {"gpiochip0", 4}

    test "pulses with each sample while it is enabled" do
      chip = chip(interrupt: @line) |> write(<<0x19, 4, 1>>) |> write(@wake)
      assert Mpu6050.pulses(0, 100 * @ms, chip) == nil
      chip = write(chip, <<0x38, 0x01>>)

      assert Mpu6050.pulses(0, 12 * @ms, chip) ==
               %{
                 line: @line,
                 width_ns: 50_000,
                 times_ns: [5 * @ms, 10 * @ms],
                 next_ns: 15 * @ms
               }

      assert %{times_ns: [10_000_000], next_ns: 15_000_000} =
               Mpu6050.pulses(5 * @ms, 10 * @ms, chip)

      assert chip |> write(<<0x6B, 0x41>>) |> then(&Mpu6050.pulses(0, @ms, &1)) == nil
      assert chip |> write(<<0x6B, 0x80>>) |> then(&Mpu6050.pulses(0, @ms, &1)) == nil
    end

    test "is wired to nothing without a line" do
      chip = chip() |> write(<<0x38, 0x01>>) |> write(@wake)
      assert Mpu6050.pulses(0, 100 * @ms, chip) == nil
    end
  end

  describe "the successors" do
    test "identify themselves, and are awake after power-on and after a reset" do
      for {model, identity} <- [mpu6500: 0x70, mpu9250: 0x71] do
        chip = chip(model: model, source: &ruler/1) |> write(<<0x1A, 1, 0, 0x18>>)
        assert peek(chip, 0x75) == identity
        assert peek(chip, 0x6B) == 0x01
        assert {12, chip} = shown(chip, 12.5)
        chip = write(chip, <<0x6B, 0x80>>, 20)
        assert peek(chip, 0x6B, 39) == 0x81
        assert {0, chip} = shown(chip, 39)
        assert peek(chip, 0x6B, 40) == 0x01
        assert {328, _} = chip |> write(<<0x1A, 1>>, 40) |> shown(41)
      end
    end

    test "have another thermometer" do
      warm = still({0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, 31.0)
      assert <<_::48, 3339::16, _::48>> = Mpu6050.encode(warm, 0, 0, :mpu6500)
    end
  end

  describe "encoding" do
    @one_g {0.0, 0.0, @g}

    test "has the sensitivity of each range" do
      for {afs_sel, lsb} <- [{0, 16_384}, {1, 8192}, {2, 4096}, {3, 2048}] do
        assert <<0::32, ^lsb::16, _::64>> = Mpu6050.encode(still(@one_g), afs_sel, 0)
      end

      rate = {0.0, 0.0, 100 * :math.pi() / 180}

      for {fs_sel, lsb} <- [{0, 13_100}, {1, 6550}, {2, 3280}, {3, 1640}] do
        assert <<_::96, ^lsb::16>> = Mpu6050.encode(still(@one_g, rate), 0, fs_sel)
      end
    end

    test "saturates" do
      far = still({3 * @g, -3 * @g, 0.0}, {10.0, -10.0, 0.0}, 1000)

      assert Mpu6050.encode(far, 0, 0) ==
               <<32_767::16, -32_768::16, 0::16, 32_767::16, 32_767::16, -32_768::16, 0::16>>
    end

    test "has the temperature at 340 LSB/°C and 0 at 36.53 °C" do
      assert <<_::48, 0::16, _::48>> = Mpu6050.encode(still(@one_g), 0, 0)

      assert <<_::48, -3400::signed-16, _::48>> =
               Mpu6050.encode(still(@one_g, {0.0, 0.0, 0.0}, 26.53), 0, 0)
    end
  end

  describe "sources" do
    test "the built-in motion follows the time since power-on" do
      chip = chip(source: :motion) |> write(<<0x19, 9, 1>>) |> write(@wake, 40)
      assert {bytes, _} = read(chip, 0x3B, 14, 1_234_567)
      assert bytes == Mpu6050.encode(Motion.at(1234.560), 0, 0)
    end

    test "a recording is played in real time, or faster" do
      {:ok, recording} = recording(5)

      for {opts, at_ms, n} <- [
            {[], 2000, 2},
            {[speed: 2], 2000, 4},
            {[], 6000, 1},
            {[at_end: :hold], 60_000, 4}
          ] do
        chip =
          chip(source: {:recording, recording, opts}) |> write(<<0x1C, 0x18>>) |> write(@wake)

        assert {x, _} = shown(chip, at_ms)
        assert x == n * 2048
      end
    end

    test "stepped, each burst takes the next sample, and other reads none" do
      {:ok, recording} = recording(3)
      chip = chip(source: {:stepped, recording}) |> write(<<0x1C, 0x18>>)
      assert {0, chip} = shown(chip, 0)
      chip = write(chip, @wake)
      assert {0, chip} = shown(chip, 0)
      assert peek(chip, 0x3A) == 1
      assert peek(chip, 0x3D) == 0
      assert {2048, chip} = shown(chip, 0)
      assert {4096, chip} = shown(chip, 0)
      assert {4096, _} = shown(chip, 0)
    end

    test "that are invalid raise, as do other wrong options" do
      {:ok, recording} = recording(1)

      for source <- [
            :wind,
            {:stepped, []},
            {:recording, "walk.csv"},
            {:recording, recording, speed: 0},
            {:recording, recording, at_end: :stop},
            {:recording, recording, sped: 1}
          ] do
        assert_raise ArgumentError, fn -> Mpu6050.init([source: source], 0) end
      end

      assert_raise ArgumentError, ~r/unknown/, fn -> Mpu6050.init([sauce: :motion], 0) end
      assert_raise ArgumentError, ~r/who_am_i/, fn -> Mpu6050.init([who_am_i: 256], 0) end
      assert_raise ArgumentError, ~r/model/, fn -> Mpu6050.init([model: :mpu1], 0) end
      assert_raise ArgumentError, ~r/reset_ms/, fn -> Mpu6050.init([reset_ms: -1], 0) end
    end

    # Sample n is taken at n seconds and has n g.
    defp recording(size) do
      header =
        "Time (s),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s)," <>
          "Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g)"

      Recording.parse(
        Enum.join([header | for(n <- 0..(size - 1), do: "#{n},0,0,0,#{n},0,0")], "\n")
      )
    end
  end
end
