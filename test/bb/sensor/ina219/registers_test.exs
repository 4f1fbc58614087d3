defmodule BB.Sensor.Ina219.RegistersTest do
  use ExUnit.Case, async: true

  alias BB.Sensor.Ina219.Registers

  doctest BB.Sensor.Ina219.Registers

  # SBOS448G, table 8: 12 V, 10 A, 2 mΩ, with steps of 1 mA.
  test "the datasheet's example comes out as it has it" do
    assert Registers.calibration(0.001, 0.002) == 20_480
    assert Registers.decode_shunt(<<2000::16>>) == 0.02
    assert Registers.decode_bus(<<0x5D98::16>>).voltage == 11.98
    assert_in_delta Registers.decode_current(<<10_000::16>>, 0.001), 10.0, 1.0e-9
    assert_in_delta Registers.decode_power(<<5990::16>>, 0.001), 119.8, 1.0e-9
  end

  # Table 7 has the shunt voltage of each range's ends.
  test "the shunt's ranges end as in the datasheet" do
    for {bytes, volts} <- [
          {<<0x7D00::16>>, 0.32},
          {<<0x3E80::16>>, 0.16},
          {<<0x1F40::16>>, 0.08},
          {<<0x0FA0::16>>, 0.04},
          {<<0xF060::16>>, -0.04},
          {<<0xE0C0::16>>, -0.08},
          {<<0xC180::16>>, -0.16},
          {<<0x8300::16>>, -0.32}
        ] do
      assert Registers.decode_shunt(bytes) == volts
    end
  end

  test "the settings after a reset are 32 V, 320 mV and one sample of 12 bits" do
    settings = %{bus_range: 32, shunt_range: 0.32, samples: 1}
    assert Registers.encode_settings(settings) == Registers.after_reset()
  end

  test "any greatest current can be shown, with steps that are hardly coarser than it needs" do
    for max_current <- [0.1, 1, 3.2, 15], shunt <- [0.001, 0.01, 0.02] do
      calibration = Registers.finest_calibration(max_current, shunt)
      lsb = Registers.current_lsb(calibration, shunt)
      assert calibration in 0..0xFFFE and rem(calibration, 2) == 0
      assert lsb * 32_768 >= max_current * (1 - 1.0e-9)
      if calibration < 0xFFFE, do: assert(lsb * 32_768 <= max_current * 1.002)
    end
  end

  test "conversions fit into the period of every rate" do
    for rate <- 1..500 do
      assert Registers.conversion_us(Registers.samples(rate)) < 1.0e6 / rate
    end
  end
end
