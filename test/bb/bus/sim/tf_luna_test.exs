defmodule BB.Bus.Sim.TfLunaTest do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim.TfLuna

  @ms 1_000_000

  defp chip(opts \\ []) do
    {:ok, chip} = TfLuna.init(opts, 0)
    chip
  end

  defp write(chip, bytes, now_ns) do
    {:ok, chip} = TfLuna.write(bytes, now_ns, chip)
    chip
  end

  defp read(chip, register, count, now_ns) do
    {:ok, bytes, chip} = TfLuna.read(count, now_ns, write(chip, <<register>>, now_ns))
    {bytes, chip}
  end

  test "it is a TF-Luna" do
    assert {"LUNA", _chip} = read(chip(), 0x3C, 4, 0)
  end

  test "it measures every 10 ms from its start, and keeps the last measurement in between" do
    chip = chip(source: fn seconds -> [distance: 1 + 100 * seconds, temperature: 40.5] end)
    assert {<<0::64>>, chip} = read(chip, 0, 8, 9 * @ms)

    assert {<<200::16-little, 1000::16-little, 4050::16-little, 10::16-little>>, chip} =
             read(chip, 0, 8, 19 * @ms)

    assert {<<300::16-little, _::32, 20::16-little>>, _chip} = read(chip, 0, 8, 20 * @ms)
  end

  test "its time wraps around after 65,536 ms" do
    assert {<<4::16-little>>, _chip} = read(chip(), 6, 2, 65_540 * @ms)
  end

  test "without a signal the distance is 0" do
    assert {<<0::16, 99::16-little>>, _chip} = read(chip(source: [signal: 99]), 0, 4, 10 * @ms)
  end

  test "a saved rate takes effect with a restart, during which the chip does not answer" do
    chip = chip(reboot_ms: 20) |> write(<<0x26, 0xFA, 0x00>>, 0)
    assert {<<0xFA, 0x00>>, chip} = read(chip, 0x26, 2, 0)
    assert {<<0::16>>, chip} = read(chip, 6, 2, 4 * @ms)

    chip = chip |> write(<<0x20, 1>>, 4 * @ms) |> write(<<0x21, 2>>, 4 * @ms)
    assert {:nak, chip} = TfLuna.write(<<0>>, 23 * @ms, chip)
    assert {:nak, chip} = TfLuna.read(1, 23 * @ms, chip)
    assert {<<0xFA, 0x00>>, chip} = read(chip, 0x26, 2, 24 * @ms)
    assert {<<4::16-little>>, _chip} = read(chip, 6, 2, 28 * @ms)
  end

  test "settings that were not saved are lost with a restart" do
    chip = chip() |> write(<<0x26, 0xFA>>, 0) |> write(<<0x21, 2>>, 0)
    assert {<<100>>, _chip} = read(chip, 0x26, 1, 0)
  end

  test "triggered, it measures once, 2 ms later" do
    chip = chip() |> write(<<0x23, 1>>, 0) |> write(<<0x20, 1, 2>>, 0)
    assert {<<0::16>>, chip} = read(chip, 6, 2, 50 * @ms)
    chip = write(chip, <<0x24, 1>>, 50 * @ms)
    assert {<<0::16>>, chip} = read(chip, 6, 2, 51 * @ms)
    assert {<<52::16-little>>, chip} = read(chip, 6, 2, 53 * @ms)
    assert {<<52::16-little>>, _chip} = read(chip, 6, 2, 90 * @ms)
  end
end
