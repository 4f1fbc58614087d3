defmodule BB.Bus.Sim.As5600Test do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim.As5600

  doctest BB.Bus.Sim.Burst

  defp read(chip, register, count, now_ns \\ 0) do
    {:ok, chip} = As5600.write(<<register>>, now_ns, chip)
    {:ok, bytes, _chip} = As5600.read(count, now_ns, chip)
    bytes
  end

  defp chip(source) do
    {:ok, chip} = As5600.init([source: source], 0)
    chip
  end

  test "the raw angle has 4096 steps in every turn" do
    turns = [{0, 0}, {0.25, 1024}, {4095 / 4096, 4095}, {7.5, 2048}, {-0.25, 3072}]

    for {turns, steps} <- turns do
      assert read(chip(angle: turns * 2 * :math.pi()), 0x0C, 2) == <<steps::16>>
    end
  end

  test "the angle follows time since power-on" do
    chip = chip(fn seconds -> [angle: seconds] end)
    assert read(chip, 0x0C, 2, 2_000_000_000) == <<1304::16>>
  end

  test "ANGLE is the raw angle from the programmed zero on" do
    {:ok, chip} = As5600.write(<<0x01, 0x04, 0x00>>, 0, chip(angle: :math.pi()))
    assert read(chip, 0x0E, 2) == <<1024::16>>
    assert read(chip, 0x0C, 2) == <<2048::16>>
  end

  test "the magnet shows in STATUS, AGC and MAGNITUDE" do
    for {magnet, bytes} <- [
          good: <<0x20, 128, 2048::16>>,
          weak: <<0x30, 255, 2048::16>>,
          strong: <<0x28, 0, 2048::16>>,
          missing: <<0x10, 255, 0::16>>
        ] do
      chip = chip(magnet: magnet)
      assert read(chip, 0x0B, 1) <> read(chip, 0x1A, 3) == bytes
    end
  end

  test "registers follow one another, and the angle's again and again" do
    {:ok, chip} = As5600.write(<<0x07, 0x03, 0x0C>>, 0, chip(angle: :math.pi() / 2))
    assert read(chip, 0x07, 7) == <<0x03, 0x0C, 0, 0, 0x20, 0x04, 0x00>>
    assert read(chip, 0x0C, 5) == <<4, 0, 4, 0, 4>>
  end

  test "a read-only register keeps its value" do
    {:ok, chip} = As5600.write(<<0x0B, 0xFF, 0xFF, 0xFF>>, 0, chip(angle: 0.0))
    assert read(chip, 0x0B, 3) == <<0x20, 0, 0>>
  end
end
