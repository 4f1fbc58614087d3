defmodule BB.Sensor.TfLunaTest do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim
  alias BB.Bus.Sim.I2C
  alias BB.Message.Sensor.Range
  alias BB.Sensor.TfLuna
  alias BB.Test.Bench

  doctest BB.Sensor.TfLuna

  setup context do
    %{bench: Bench.new(TfLuna, %{0x10 => {Sim.TfLuna, Map.get(context, :device, [])}})}
  end

  defp replace(bench, source),
    do: Bench.replace(bench, 0x10, {Sim.TfLuna, source: source})

  # The test sets the target.
  defp knob(bench, signal) do
    knob = :counters.new(1, [])
    :counters.put(knob, 1, signal)
    replace(bench, fn _seconds -> [signal: :counters.get(knob, 1)] end)
    knob
  end

  # Time on this bus stands still.
  defp frozen(device) do
    name = "i2c-frozen-#{System.unique_integer([:positive])}"
    clock = :counters.new(1, [])
    bus = [devices: %{0x10 => device}, clock: fn -> :counters.get(clock, 1) end]
    start_supervised!({Sim, buses: %{name => bus}}, id: name)
    {name, clock}
  end

  defp open(name, opts \\ []) do
    {:ok, opts} = BB.Options.validate([bus: name] ++ opts, TfLuna.options_schema())
    TfLuna.open(opts)
  end

  describe "a message" do
    @tag device: [source: [distance: 2.5]]
    test "is a range in metres", %{bench: bench} do
      Bench.start!(bench)
      message = Bench.reading()
      assert message.frame_id == :sensor

      assert %Range{radiation_type: :infrared, min_range: 0.2, max_range: 8.0, range: 2.5} =
               message.payload

      assert_in_delta message.payload.field_of_view, 0.0349, 0.0001
    end

    test "without enough light is :infinity", %{bench: bench} do
      replace(bench, distance: 3.0, signal: 99)
      Bench.start!(bench)
      assert Bench.reading().payload.range == :infinity
    end

    test "is :infinity beyond its range", %{bench: bench} do
      replace(bench, distance: 9.5)
      Bench.start!(bench)
      assert Bench.reading().payload.range == :infinity
    end

    test "needs a signal as strong as the option", %{bench: bench} do
      replace(bench, distance: 3.0, signal: 499)
      Bench.start!(bench, min_signal: 500)
      assert Bench.reading().payload.range == :infinity
    end
  end

  describe "a measurement" do
    test "is published once, at any rate" do
      {name, clock} = frozen({Sim.TfLuna, source: [distance: 2.0]})

      {:ok, chip} = open(name)

      :counters.put(clock, 1, 11_000_000)
      assert {:ok, %{range: 2.0, age_ns: 0}, chip} = TfLuna.measure(chip, 0)
      assert {:none, {:idle, _, 0x10}, chip} = TfLuna.measure(chip, 0)
      :counters.put(clock, 1, 21_000_000)
      assert {:ok, _reading, chip} = TfLuna.measure(chip, 0)
      TfLuna.close(chip)
    end

    test "is none before the chip's first one" do
      {name, clock} = frozen({Sim.TfLuna, []})
      :counters.put(clock, 1, 10_000_000)
      {:ok, chip} = open(name)
      assert chip.tick == 10
      :ok = Sim.unplug(name, 0x10)
      :ok = Sim.replug(name, 0x10)
      assert {:none, {:idle, _, 0x10}, chip} = TfLuna.measure(chip, 0)
      TfLuna.close(chip)
    end

    test "that was triggered has the time of its trigger" do
      {name, clock} = frozen({Sim.TfLuna, source: [distance: 2.0]})

      {:ok, chip} = open(name, mode: :triggered)

      # Nothing was triggered before.
      :counters.put(clock, 1, 20_000_000)
      assert {:none, {:idle, _, 0x10}, chip} = TfLuna.measure(chip, 20_000_000)
      :counters.put(clock, 1, 40_000_000)
      assert {:ok, %{range: 2.0, age_ns: 20_000_000}, chip} = TfLuna.measure(chip, 40_000_000)
      :counters.put(clock, 1, 61_000_000)
      assert {:ok, %{range: 2.0, age_ns: 21_000_000}, chip} = TfLuna.measure(chip, 61_000_000)
      TfLuna.close(chip)
    end
  end

  describe "the chip" do
    @tag device: [reboot_ms: 120]
    test "is made to measure faster than it is read, and keeps that", %{bench: bench} do
      Bench.start!(bench, rate: BB.Unit.new!(0.1, :kilohertz))
      Bench.reading()
      {:ok, bus} = I2C.open(bench.bus)
      assert I2C.write_read(bus, 0x10, <<0x23>>, 5) == {:ok, <<0, 0, 0, 125, 0>>}
    end

    # A restart loses the time since the last one.
    test "is not restarted when its settings are right" do
      {name, clock} = frozen({Sim.TfLuna, []})
      :counters.put(clock, 1, 30_000_000)

      {:ok, chip} = open(name)

      assert chip.tick == 30
      TfLuna.close(chip)
    end

    test "can measure when triggered", %{bench: bench} do
      Bench.start!(bench, mode: :triggered, rate: 100)
      assert Bench.reading().payload.range == 1.0
      assert Bench.reading().payload.range == 1.0
    end
  end

  describe "it does not start" do
    test "without an answer", %{bench: bench} do
      :ok = Sim.unplug(bench.bus, 0x10)
      assert Bench.start(bench) == {:error, {:no_answer, bench.bus, 0x10}}
    end

    @tag device: [signature: "MINI"]
    test "with another chip", %{bench: bench} do
      assert {:error, reason} = Bench.start(bench)
      assert reason == {:wrong_chip, bench.bus, 0x10, "MINI", "LUNA"}
      assert TfLuna.explain(reason) =~ ~s(identifies itself as "MINI" instead of "LUNA")
    end

    test "with too much light", %{bench: bench} do
      replace(bench, signal: 65_535)
      # Before its first measurement it has no data.
      {:ok, bus} = I2C.open(bench.bus)
      :ok = I2C.write(bus, 0x10, <<0x26, 250>>)
      :ok = I2C.write(bus, 0x10, <<0x20, 1, 2>>)
      BB.Test.Eventually.eventually(fn -> measured?(bus) end)
      assert Bench.start(bench, rate: 200) == {:error, {:dazzled, bench.bus, 0x10}}
    end

    defp measured?(bus),
      do: match?({:ok, <<_, _, 0xFF, 0xFF>>}, I2C.write_read(bus, 0x10, <<0>>, 4))

    test "with wrong options, and names them", %{bench: bench} do
      for {opts, message} <- [
            {[address: 0x78], ":address"},
            {[rate: 201], "expected a frequency of 1 to 200 hertz"},
            {[mode: :single], ":mode"},
            {[min_signal: 99], ":min_signal"}
          ] do
        assert {:error, %BB.Options.ValidationError{} = error} = Bench.start(bench, opts)
        assert Exception.message(error) =~ message
      end
    end
  end

  describe "in use" do
    test "too much light ends it with the reason, and nothing is published", %{bench: bench} do
      knob = knob(bench, 1000)
      pid = Bench.start!(bench, rate: 100)
      Bench.reading()

      # A measurement from before may still be read once.
      fault = fn -> :counters.put(knob, 1, 65_535) end
      assert Bench.reason_of_end(pid, fault) == {:shutdown, {:dazzled, bench.bus, 0x10}}
    end

    test "a pulled wire ends it after three readings without a message", %{bench: bench} do
      pid = Bench.start!(bench)

      assert Bench.reason_after(pid, fn -> :ok = Sim.unplug(bench.bus, 0x10) end) ==
               {:shutdown, {:no_answer, bench.bus, 0x10}}
    end

    test "another chip's settings after a failure end it, so that it is set up again", %{
      bench: bench
    } do
      pid = Bench.start!(bench, rate: 10)

      fault = fn ->
        Bench.cut_power(bench, 0x10)
        :ok = Sim.fault(bench.bus, 0x10, {:nak, 1})
      end

      assert Bench.reason_after(pid, fault) == {:shutdown, {:restarted, bench.bus, 0x10}}
    end

    test "a moment without power brings no old measurement", %{bench: bench} do
      knob = knob(bench, 1000)
      pid = Bench.start!(bench, rate: 20)
      Bench.reading()

      Bench.between_readings(pid, fn ->
        :counters.put(knob, 1, 10)
        Bench.cut_power(bench, 0x10)
      end)

      assert Bench.reading().payload.range == :infinity
    end
  end

  test "new options set the chip up again", %{bench: bench} do
    {:ok, sensor} = TfLuna.init(Bench.options(bench, rate: 50))
    assert {:ok, sensor} = TfLuna.handle_options(Bench.options(bench, rate: 100), sensor)
    {:ok, bus} = I2C.open(bench.bus)
    assert I2C.write_read(bus, 0x10, <<0x26>>, 1) == {:ok, <<125>>}
    TfLuna.terminate(:normal, sensor)
    assert {:error, {:bus, _, _, {:errno, 9}}} = TfLuna.check(sensor.device)
  end

  test "every reason is explained" do
    for reason <- [:dazzled, :idle, :no_answer],
        do: assert(TfLuna.explain({reason, "i2c-1", 0x10}) =~ "0x10 on i2c-1")
  end
end
