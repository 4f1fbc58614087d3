defmodule BB.Sensor.As5600.RegistersTest do
  use ExUnit.Case, async: true

  alias BB.Sensor.As5600.Registers

  doctest BB.Sensor.As5600.Registers

  # Figure 22: SF are bits 9:8, HYST bits 3:2, PM bits 1:0, WD bit 13.
  test "the settings go to the bits that the datasheet has for them" do
    for {filter, code} <- [{16, 0x000}, {8, 0x100}, {4, 0x200}, {2, 0x300}],
        hysteresis <- 0..3 do
      settings = %{filter: filter, hysteresis: hysteresis}
      <<conf::16>> = Registers.encode_conf(settings, <<0::16>>)
      assert conf == code + hysteresis * 4
      <<conf::16>> = Registers.encode_conf(settings, <<0xFFFF::16>>)
      assert conf == 0xDCF0 + code + hysteresis * 4
    end
  end

  test "an inverted CONF differs in each of these bits, and in no other" do
    for conf <- 0..0xFFFF do
      <<inverted::16>> = Registers.inverted(<<conf::16>>)
      assert Bitwise.bxor(conf, inverted) == 0x030C
    end
  end

  # Figure 2: 12 bits, 0.0879° a step.
  test "a step is the 4096th part of a turn" do
    assert_in_delta Registers.radians(1) * 180 / :math.pi(), 0.0879, 0.0001
    assert Registers.radians(4096) == 2 * :math.pi()
  end
end
