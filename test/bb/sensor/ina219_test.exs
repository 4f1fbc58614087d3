defmodule BB.Sensor.Ina219Test do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim
  alias BB.Bus.Sim.I2C
  alias BB.Message.Sensor.PowerState
  alias BB.Sensor.Ina219
  alias BB.Test.Bench

  doctest BB.Sensor.Ina219

  setup context do
    device = {Sim.Ina219, Map.get(context, :device, [])}
    %{bench: Bench.new(Ina219, %{0x40 => device})}
  end

  @tag device: [source: [voltage: 11.98, current: 10.0], shunt: 0.002]
  test "a reading is the rail's voltage, current and power", %{bench: bench} do
    Bench.start!(bench, rate: 200, shunt: 0.002, max_current: 15)
    message = Bench.reading()
    assert message.frame_id == :sensor
    assert %PowerState{voltage: 11.98, shunt_voltage: 0.02} = message.payload
    assert_in_delta message.payload.current, 10.0, 0.001
    assert_in_delta message.payload.power, 119.8, 0.02
  end

  @tag device: [source: [voltage: 7.4, current: -0.25]]
  test "the current's sign is its direction", %{bench: bench} do
    Bench.start!(bench, rate: 200)
    assert_in_delta Bench.reading().payload.current, -0.25, 0.0002
  end

  @tag device: [source: [current: 0.0]]
  test "a current of zero is published", %{bench: bench} do
    Bench.start!(bench, rate: 200)
    assert Bench.reading().payload.current == 0.0
    assert Bench.reading().payload.current == 0.0
  end

  @tag device: [source: [current: 0.2]]
  test "its options may be units", %{bench: bench} do
    unit = &BB.Unit.new!/2

    Bench.start!(bench,
      rate: unit.(0.2, :kilohertz),
      shunt: unit.(100, :milliohm),
      max_current: unit.(400, :milliampere),
      voltage_range: 16
    )

    {:ok, bus} = I2C.open(bench.bus)
    # 16 V, 40 mV, twice one sample, all the time; 0.04096 / (0.4 / 32768 · 0.1)
    assert I2C.write_read(bus, 0x40, <<0>>, 2) == {:ok, <<0x04, 0xCF>>}
    assert I2C.write_read(bus, 0x40, <<5>>, 2) == {:ok, <<33_554::16>>}
  end

  test "the messages have the frame of the option", %{bench: bench} do
    Bench.start!(bench, frame_id: :battery)
    assert Bench.reading().frame_id == :battery
  end

  test "a measurement is published once, at any rate", %{bench: bench} do
    {:ok, chip} = Ina219.open(Bench.options(bench, rate: 1))
    # The first is there when the start returns, and the next more than a tenth of a second later.
    assert {:ok, _reading, chip} = Ina219.measure(chip, 0)
    assert {:none, {:idle, _, 0x40}, _chip} = Ina219.measure(chip, 0)
    Ina219.close(chip)
  end

  test "a chip that no longer measures is a fault", %{bench: bench} do
    pid = Bench.start!(bench, rate: 200)
    {:ok, bus} = I2C.open(bench.bus)

    # Powered down, with its calibration. The settings are looked at after the first failure.
    fault = fn -> :ok = I2C.write(bus, 0x40, <<0, 0x39, 0x98>>) end
    assert Bench.reason_after(pid, fault) == {:shutdown, {:restarted, bench.bus, 0x40}}
  end

  describe "it does not start" do
    test "without an answer", %{bench: bench} do
      :ok = Sim.unplug(bench.bus, 0x40)
      assert Bench.start(bench) == {:error, {:no_answer, bench.bus, 0x40}}
    end

    @tag device: [reset_value: 0x4127]
    test "with another chip", %{bench: bench} do
      assert Bench.start(bench) ==
               {:error, {:wrong_chip, bench.bus, 0x40, <<0x41, 0x27>>, <<0x39, 0x9F>>}}
    end

    @tag device: [source: [current: 5.0]]
    test "beyond its range", %{bench: bench} do
      assert Bench.start(bench) == {:error, {:overflow, bench.bus, 0x40}}
    end

    test "with a shunt that is too large for the current", %{bench: bench} do
      assert Bench.start(bench, shunt: 0.1, max_current: 5) == {:error, {:shunt_too_large, 0.5}}
    end

    test "with wrong options, and names them", %{bench: bench} do
      for {opts, message} <- [
            {[address: 0x50], ":address"},
            {[rate: 501], "expected a frequency of 1 to 500 hertz"},
            {[shunt: 0], "expected a resistance of"},
            {[max_current: BB.Unit.new!(1, :volt)], "expected a current of 0.001 to 1000 ampere"},
            {[voltage_range: 12], ":voltage_range"}
          ] do
        assert {:error, %BB.Options.ValidationError{} = error} = Bench.start(bench, opts)
        assert Exception.message(error) =~ message
      end
    end
  end

  describe "in use" do
    test "a current beyond its range ends it with the reason", %{bench: bench} do
      current = :counters.new(1, [])
      source = fn _seconds -> [current: :counters.get(current, 1) / 1] end
      :ok = Sim.unplug(bench.bus, 0x40)
      :ok = Sim.plug(bench.bus, 0x40, {Sim.Ina219, source: source})
      pid = Bench.start!(bench, rate: 200, max_current: 2)
      Bench.reading()
      # What was measured before the change may still be read once.
      fault = fn -> :counters.put(current, 1, 4) end
      assert Bench.reason_of_end(pid, fault) == {:shutdown, {:overflow, bench.bus, 0x40}}
      for message <- heard(), do: assert(message.payload.current == 0.0)
    end

    defp heard do
      receive do
        {:bb, _path, message} -> [message | heard()]
      after
        0 -> []
      end
    end

    test "a pulled wire ends it after three readings without a message", %{bench: bench} do
      pid = Bench.start!(bench, rate: 200)

      assert Bench.reason_after(pid, fn -> :ok = Sim.unplug(bench.bus, 0x40) end) ==
               {:shutdown, {:no_answer, bench.bus, 0x40}}
    end

    test "two failed readings are overcome", %{bench: bench} do
      pid = Bench.start!(bench, rate: 200)
      Bench.reading()
      Bench.between_readings(pid, fn -> :ok = Sim.fault(bench.bus, 0x40, {:nak, 2}) end)
      Bench.reading()
      assert Process.alive?(pid)
    end

    test "a moment without power ends it at once, and no current of 0 is published", %{
      bench: bench
    } do
      pid = Bench.start!(bench, rate: 200)

      assert Bench.reason_after(pid, fn -> Bench.cut_power(bench, 0x40) end) ==
               {:shutdown, {:restarted, bench.bus, 0x40}}
    end
  end

  @tag device: [source: [current: 0.2]]
  test "new options set the chip up again", %{bench: bench} do
    {:ok, sensor} = Ina219.init(Bench.options(bench, rate: 100))
    assert {:ok, sensor} = Ina219.handle_options(Bench.options(bench, max_current: 0.4), sensor)
    {:ok, bus} = I2C.open(bench.bus)
    assert I2C.write_read(bus, 0x40, <<5>>, 2) == {:ok, <<33_554::16>>}
    Ina219.terminate(:normal, sensor)

    assert {:error, {:bus, _, _, {:errno, 9}}} = Ina219.check(sensor.device)
  end

  test "every reason is explained" do
    assert Ina219.explain({:idle, "i2c-1", 0x40}) =~ "0x40 on i2c-1 has stopped measuring"
    assert Ina219.explain({:no_answer, "i2c-1", 0x40}) =~ "no answer at 0x40 on i2c-1"
  end
end
