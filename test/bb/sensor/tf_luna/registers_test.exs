defmodule BB.Sensor.TfLuna.RegistersTest do
  use ExUnit.Case, async: true

  alias BB.Sensor.TfLuna.Registers

  doctest BB.Sensor.TfLuna.Registers

  test "any rate of the option has a faster one of the chip, 500 Hz divided by an integer" do
    for rate <- 1..200 do
      frame_rate = Registers.frame_rate(rate)
      assert frame_rate > rate
      assert rem(500, frame_rate) == 0
    end
  end

  test "numbers have the low byte first, and temperatures a sign" do
    assert Registers.decode(<<0x20, 0x03, 0x64, 0x00, 0x0C, 0xFE, 0xFF, 0xFF>>) ==
             %{distance: 8.0, signal: 100, temperature: -5.0, tick: 65_535}
  end

  test "the settings of a new chip are by itself, 100 Hz" do
    assert Registers.encode_settings(%{mode: :continuous, frame_rate: 100}) ==
             {<<0x00>>, <<0x64, 0x00>>}
  end
end
