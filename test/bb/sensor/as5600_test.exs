defmodule BB.Sensor.As5600Test do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim
  alias BB.Bus.Sim.I2C
  alias BB.Message.Sensor.JointState
  alias BB.Sensor.As5600
  alias BB.Test.Bench

  doctest BB.Sensor.As5600

  @step 2 * :math.pi() / 4096

  # The test sets the magnet's angle, in thousandths of a turn.
  setup context do
    knob = :counters.new(1, [])
    source = fn _seconds -> [angle: :counters.get(knob, 1) * 2 * :math.pi() / 1000] end
    device = {Sim.As5600, Map.get(context, :device, source: source)}
    %{bench: Bench.new(As5600, %{0x36 => device}), knob: knob}
  end

  defp replace(bench, source),
    do: Bench.replace(bench, 0x36, {Sim.As5600, source: source})

  defp position(%{payload: %JointState{positions: [position]}}), do: position

  describe "a message" do
    test "is a joint state of the sensor's name, at first without velocity", %{bench: bench} do
      Bench.start!(bench)
      message = Bench.reading()
      assert message.frame_id == :sensor
      assert message.payload == %JointState{names: [:sensor], positions: [0.0]}
      assert Bench.reading().payload.velocities == [0.0]
    end

    # The test gives the times: a machine that stands still would make any turn too fast.
    test "counts the turns, forth and back", %{bench: bench, knob: knob} do
      {:ok, chip} = As5600.open(Bench.options(bench, []))
      way = Enum.concat([0..3000//300, 2700..-3000//-300])

      for {thousandths, n} <- Enum.with_index(way), reduce: chip do
        chip ->
          :counters.put(knob, 1, thousandths)
          {:ok, reading, chip} = As5600.measure(chip, n * 10_000_000)
          assert_in_delta reading.position, thousandths * 2 * :math.pi() / 1000, @step
          chip
      end

      As5600.close(chip)
    end

    test "has the velocity", %{bench: bench} do
      # Slow enough that no half turn is between two readings, however late they are.
      replace(bench, fn seconds -> [angle: 0.1 * seconds] end)
      Bench.start!(bench, rate: 200, velocity_window: BB.Unit.new!(100, :millisecond))
      # At first it has not turned by a step.
      moving = Bench.reading(fn %{payload: turn} -> turn.velocities not in [[], [0.0]] end)
      assert [velocity] = moving.payload.velocities
      assert velocity > 0
    end

    test "begins in the turn of the option", %{bench: bench, knob: knob} do
      :counters.put(knob, 1, 750)
      Bench.start!(bench)
      assert_in_delta position(Bench.reading()), -:math.pi() / 2, @step
      Bench.stop()
      # Of the sensor that has stopped there may be one left.
      Bench.start!(bench, from: BB.Unit.new!(0, :degree))
      assert_in_delta Bench.reading(&(position(&1) > 0)) |> position(), 3 * :math.pi() / 2, @step
    end
  end

  test "the chip gets its settings, and keeps the other bits", %{bench: bench} do
    {:ok, bus} = I2C.open(bench.bus)
    :ok = I2C.write(bus, 0x36, <<0x07, 0xC4, 0x53>>)
    Bench.start!(bench, filter: 4, hysteresis: 2)
    Bench.reading()
    assert I2C.write_read(bus, 0x36, <<0x07>>, 2) == {:ok, <<0xC6, 0x58>>}
  end

  describe "it does not start" do
    test "without an answer", %{bench: bench} do
      :ok = Sim.unplug(bench.bus, 0x36)
      assert Bench.start(bench) == {:error, {:no_answer, bench.bus, 0x36}}
    end

    test "with a chip that keeps no settings", %{bench: bench} do
      :ok = Sim.unplug(bench.bus, 0x36)
      # Asleep, an MPU-6050 has no registers there.
      :ok = Sim.plug(bench.bus, 0x36, {Sim.Mpu6050, []})
      assert Bench.start(bench) == {:error, {:not_configured, bench.bus, 0x36}}
    end

    test "without a magnet that is as it should be", %{bench: bench} do
      for {magnet, reason} <- [
            missing: :no_magnet,
            weak: :magnet_too_weak,
            strong: :magnet_too_strong
          ] do
        replace(bench, magnet: magnet)
        assert Bench.start(bench) == {:error, {reason, bench.bus, 0x36}}
      end
    end

    test "with wrong options, and names them", %{bench: bench} do
      for {opts, message} <- [
            {[address: 0x37], ":address"},
            {[rate: 0], "expected a frequency of 1 to 1000 hertz"},
            {[from: BB.Unit.new!(1, :meter)], "expected an angle of"},
            {[velocity_window: 0], "expected a time of"},
            {[filter: 3], ":filter"},
            {[hysteresis: 4], ":hysteresis"},
            {[magnet: :bad], ":magnet"}
          ] do
        assert {:error, %BB.Options.ValidationError{} = error} = Bench.start(bench, opts)
        assert Exception.message(error) =~ message
      end
    end
  end

  test "a weak or strong magnet can be accepted, a missing one cannot", %{bench: bench} do
    for magnet <- [:weak, :strong] do
      replace(bench, magnet: magnet, angle: 0.0)
      Bench.start!(bench, magnet: :any)
      Bench.reading()
      Bench.stop()
    end

    replace(bench, magnet: :missing)
    assert Bench.start(bench, magnet: :any) == {:error, {:no_magnet, bench.bus, 0x36}}
  end

  describe "in use" do
    test "a magnet that falls off ends it with the reason, and nothing is published", %{
      bench: bench
    } do
      fallen = :counters.new(1, [])

      replace(bench, fn _seconds ->
        [magnet: if(:counters.get(fallen, 1) == 0, do: :good, else: :missing)]
      end)

      pid = Bench.start!(bench)

      assert Bench.reason_after(pid, fn -> :counters.put(fallen, 1, 1) end) ==
               {:shutdown, {:no_magnet, bench.bus, 0x36}}
    end

    test "half a turn at once ends it at once: the turns are no longer known", %{
      bench: bench,
      knob: knob
    } do
      pid = Bench.start!(bench)

      assert Bench.reason_after(pid, fn -> :counters.put(knob, 1, 500) end) ==
               {:shutdown, {:too_fast, bench.bus, 0x36}}
    end

    test "a pulled wire ends it after three readings without a message", %{bench: bench} do
      pid = Bench.start!(bench)

      assert Bench.reason_after(pid, fn -> :ok = Sim.unplug(bench.bus, 0x36) end) ==
               {:shutdown, {:no_answer, bench.bus, 0x36}}
    end

    test "a moment without power ends it at once, so that it is set up again", %{bench: bench} do
      pid = Bench.start!(bench, filter: 2)

      assert Bench.reason_after(pid, fn -> Bench.cut_power(bench, 0x36) end) ==
               {:shutdown, {:restarted, bench.bus, 0x36}}
    end
  end

  test "new options keep the turns, at the same place", %{bench: bench} do
    {:ok, sensor} = As5600.init(Bench.options(bench, rate: 100))
    {:ok, _reading, chip} = As5600.measure(sensor.device, 0)
    sensor = %{sensor | device: put_in(chip.track.position, 3 * 4096)}

    assert {:ok, sensor} = As5600.handle_options(Bench.options(bench, filter: 2), sensor)
    assert {:ok, %{position: position}, _chip} = As5600.measure(sensor.device, 10_000_000)
    assert_in_delta position, 6 * :math.pi(), @step

    assert {:stop, {:no_answer, _, 0x40}} =
             As5600.handle_options(Bench.options(bench, address: 0x40), sensor)
  end

  test "every reason is explained" do
    for reason <- [:no_magnet, :magnet_too_weak, :magnet_too_strong, :too_fast, :restarted] do
      assert As5600.explain({reason, "i2c-1", 0x36}) =~ "0x36 on i2c-1"
    end
  end
end
