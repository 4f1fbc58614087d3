defmodule BB.Bus.Sim.Ina219Test do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim.Ina219

  @ms 1_000_000

  defp chip(opts \\ []) do
    {:ok, chip} = Ina219.init(opts, 0)
    chip
  end

  defp write(chip, register, value, now_ns) do
    {:ok, chip} = Ina219.write(<<register, value::16>>, now_ns, chip)
    chip
  end

  defp read(chip, register, now_ns) do
    {:ok, chip} = Ina219.write(<<register>>, now_ns, chip)
    {:ok, <<value::16>>, chip} = Ina219.read(2, now_ns, chip)
    {value, chip}
  end

  # SBOS448G, table 8.
  test "the datasheet's example reads as it has it" do
    chip = chip(source: [voltage: 11.98, current: 10.0], shunt: 0.002)
    chip = chip |> write(0, 0x019F, 0) |> write(5, 0x5000, 0)
    assert {0x07D0, chip} = read(chip, 1, 2 * @ms)
    assert {0x5D9A, chip} = read(chip, 2, 2 * @ms)
    assert {0x2710, chip} = read(chip, 4, 2 * @ms)
    assert {0x1766, _chip} = read(chip, 3, 2 * @ms)
  end

  test "it has measured after both conversions, and its flag stays set until POWER is read" do
    chip = write(chip(), 0, 0x399F, 0)
    assert {0, chip} = read(chip, 2, 1_063_999)
    assert {0x5DC2, chip} = read(chip, 2, 1_064_000)
    {_power, chip} = read(chip, 3, 1_064_000)
    assert {0x5DC0, chip} = read(chip, 2, 2_127_999)
    assert {0x5DC2, _chip} = read(chip, 2, 2_128_000)
  end

  test "128 samples take 136.2 ms" do
    chip = write(chip(), 0, 0x3FFF, 0)
    assert {0, chip} = read(chip, 2, 136 * @ms)
    assert {0x5DC2, _chip} = read(chip, 2, 137 * @ms)
  end

  test "without calibration there is no current" do
    {current, chip} = read(chip(), 4, 2 * @ms)
    assert {current, elem(read(chip, 5, 2 * @ms), 0)} == {0, 0}
  end

  test "the lowest bit of the calibration is always 0" do
    assert {0x5000, _chip} = chip() |> write(5, 0x5001, 0) |> read(5, 0)
  end

  test "the shunt's voltage ends at its range, in both directions" do
    for {current, config, value} <- [{5.0, 0x399F, 32_000}, {-5.0, 0x219F, 0xF060}] do
      chip = chip(source: [current: current]) |> write(0, config, 0)
      assert {^value, _chip} = read(chip, 1, 2 * @ms)
    end
  end

  test "a current beyond 16 bits sets the overflow flag" do
    chip = chip(source: [current: 3.0]) |> write(5, 0xFFFE, 0)
    assert {0x5DC3, _chip} = read(chip, 2, 2 * @ms)
  end

  test "triggered, it measures once" do
    chip = write(chip(), 0, 0x399B, 0)
    assert {0x5DC2, chip} = read(chip, 2, 2 * @ms)
    {_power, chip} = read(chip, 3, 2 * @ms)
    assert {0x5DC0, _chip} = read(chip, 2, 9 * @ms)
  end

  test "a reset restores the registers of power-on" do
    chip = chip() |> write(5, 0x5000, 0) |> write(0, 0x8000, 0)
    assert {0x399F, chip} = read(chip, 0, 0)
    assert {0, _chip} = read(chip, 5, 0)
  end

  test "other registers and counts are not answered" do
    assert {:nak, _chip} = Ina219.write(<<6>>, 0, chip())
    assert {:nak, _chip} = Ina219.read(3, 0, chip())
  end
end
