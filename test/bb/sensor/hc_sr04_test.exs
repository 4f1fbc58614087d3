defmodule BB.Sensor.HcSr04Test do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.LineBench

  alias BB.Bus.Sim
  alias BB.Bus.Sim.{GPIO, Lines}
  alias BB.Message.Sensor.Range
  alias BB.Safety
  alias BB.Sensor.HcSr04
  alias BB.Test.Robot

  doctest HcSr04

  @period 0.1

  # Tells when the trigger was set, as seen from the driver's side.
  defmodule Watched do
    def open(spec, direction, opts), do: GPIO.open(spec, direction, opts)
    def close(line), do: GPIO.close(line)
    def read(line), do: GPIO.read(line)
    def set_interrupts(line, trigger), do: GPIO.set_interrupts(line, trigger)

    def write(line, level) do
      send(:persistent_term.get({__MODULE__, hd(line.locations)}), {:write, level, now_ns()})
      GPIO.write(line, level)
    end

    defp now_ns, do: System.monotonic_time(:nanosecond)
  end

  setup context do
    device = {Sim.HcSr04, [pins: [trigger: 23, echo: 24]] ++ (context[:device] || [])}
    start(devices: %{sonar: device})
  end

  defp lines(bench), do: [trigger: {bench.chip, 23}, echo: {bench.chip, 24}]
  defp sonar!(bench, opts \\ []), do: run!(bench, HcSr04, lines(bench) ++ opts)
  defp ranges, do: for(%Range{range: range} <- published(), do: range)

  describe "a reading" do
    for distance <- [0.03, 0.5, 3.9] do
      @tag device: [distance: distance]
      test "is #{distance} m where a thing is there", bench do
        pid = sonar!(bench)
        pass(bench, @period + 0.05, pid)
        assert [range] = ranges()
        assert_in_delta range, unquote(distance), 1.0e-5
      end
    end

    @tag device: [distance: :infinity]
    test "is :infinity where nothing is", bench do
      pid = sonar!(bench)
      pass(bench, @period + 0.05, pid)
      assert ranges() == [:infinity]
    end

    @tag device: [distance: 2.5]
    test "is :infinity beyond the option max_range", bench do
      pid = sonar!(bench, max_range: BB.Unit.new!(200, :centimeter))
      pass(bench, @period + 0.05, pid)
      assert [%Range{range: :infinity, max_range: 2.0, min_range: 0.02} = range] = published()
      assert range.radiation_type == :ultrasound
      assert_in_delta range.field_of_view, 0.2618, 0.0001
    end

    # A minute passes in a moment: only the edges know of it.
    @tag device: [distance: 1.0]
    test "has the time at which its echo ended", bench do
      pid = sonar!(bench)
      pass(bench, 60, pid)
      started_ns = System.monotonic_time(:nanosecond)
      times = for _ <- 1..500, do: next_time()
      assert List.last(times) > started_ns + 30_000_000_000
    end

    defp next_time do
      assert_receive {:bb, [:sensor | _], %{monotonic_time: time, payload: %Range{}}}
      time
    end

    @tag device: [distance: 1.0, speed_of_sound: 331.0]
    test "uses the speed of sound of its option", bench do
      pid = sonar!(bench, speed_of_sound: 331)
      pass(bench, @period + 0.05, pid)
      assert [range] = ranges()
      assert_in_delta range, 1.0, 1.0e-5
    end

    test "comes at its rate", bench do
      pid = sonar!(bench, rate: 16)
      pass(bench, 10.05, pid)
      assert length(ranges()) == 160
    end

    @tag device: [distance: &__MODULE__.coming/1]
    test "is measured at its own time, not at the one before", bench do
      pid = sonar!(bench)
      pass(bench, 2.05, pid)
      seen = ranges()
      assert length(seen) == 20

      for {range, n} <- Enum.with_index(seen, 1),
          do: assert_in_delta(range, 3.0 - n * 0.1, 1.0e-3)
    end
  end

  def coming(seconds), do: 3.0 - seconds

  test "the trigger is high for 10 µs at least", bench do
    :persistent_term.put({Watched, {bench.chip, 23}}, self())
    pid = sonar!(bench, gpio: Watched)
    pass(bench, @period, pid)
    assert_received {:write, 1, up_ns}
    assert_received {:write, 0, down_ns}
    assert down_ns - up_ns >= 10_000
  end

  describe "a fault:" do
    test "no echo, three times in a row", bench do
      pid = sonar!(bench)
      monitor = Process.monitor(pid)
      :ok = Lines.unplug(bench.chip, :sonar)
      pass(bench, 5 * @period, pid)
      reason = {:no_echo, {bench.chip, 23}, {bench.chip, 24}}
      assert_receive {:DOWN, ^monitor, _, _, {:shutdown, ^reason}}
      assert ranges() == []
    end

    test "an echo that does not end", bench do
      pid = sonar!(bench)
      monitor = Process.monitor(pid)
      :ok = Lines.fault({bench.chip, 24}, {:short, 1})
      pass(bench, 5 * @period, pid)
      reason = {:echo_stuck, {bench.chip, 24}}
      assert_receive {:DOWN, ^monitor, _, _, {:shutdown, ^reason}}
      assert ranges() == []
    end

    test "edges that belong to no burst", bench do
      pid = sonar!(bench)
      monitor = Process.monitor(pid)
      :ok = Lines.fault({bench.chip, 24}, {:storm, 20_000})
      pass(bench, 8 * @period, pid)
      reason = {:noise, {bench.chip, 24}}
      assert_receive {:DOWN, ^monitor, _, _, {:shutdown, ^reason}}
      assert ranges() == []
    end

    test "once, and it continues", bench do
      pid = sonar!(bench)
      :ok = Lines.unplug(bench.chip, :sonar)
      pass(bench, 2 * @period, pid)
      assert ranges() == []
      :ok = Lines.replug(bench.chip, :sonar)
      pass(bench, 2 * @period, pid)
      assert ranges() != []
      assert Process.alive?(pid)
    end
  end

  describe "in a robot, with the machine's time," do
    setup do
      chip = "gpiochip-sonar-#{System.unique_integer([:positive])}"
      devices = %{sonar: {Sim.HcSr04, pins: [trigger: 23, echo: 24]}}
      start_supervised!({Lines, chips: %{chip => [devices: devices]}}, id: chip)

      robot =
        Robot.create(
          quote do
            sensors do
              sensor :sonar,
                     {HcSr04, trigger: {unquote(chip), 23}, echo: {unquote(chip), 24}, rate: 16}
            end
          end
        )

      %{robot: robot, chip: chip}
    end

    defp await(robot, state),
      do: assert(eventually(fn -> Robot.health(robot, :sonar).state == state end))

    test "it is not up before its first echo", %{robot: robot, chip: chip} do
      :ok = Lines.fault({chip, 24}, :cut)
      start_supervised!(robot)
      await(robot, :backoff)
      assert Robot.health(robot, :sonar).last_error == {:no_echo, {chip, 23}, {chip, 24}}
      :ok = Lines.clear({chip, 24})
      await(robot, :up)
    end

    test "disarming sets the trigger low, and the sensor continues", %{robot: robot} do
      start_supervised!(robot)
      await(robot, :up)
      pid = BB.Process.whereis(robot, :sonar)
      :ok = Safety.arm(robot)
      assert Safety.disarm(robot) == :ok
      {:ok, _} = BB.subscribe(robot, [:sensor, :sonar])
      for _ <- 1..3, do: assert_receive({:bb, _, %{payload: %Range{}}})
      assert BB.Process.whereis(robot, :sonar) == pid
    end

    test "a trigger that is held up by a process that hangs is let down", context do
      %{robot: robot, chip: chip} = context
      start_supervised!(robot)
      await(robot, :up)
      :ok = Safety.arm(robot)
      pid = BB.Process.whereis(robot, :sonar)
      :ok = :sys.suspend(pid)
      {:ok, line} = GPIO.open({chip, 23}, :output, initial_value: 1, on_busy: :take_over)
      assert Lines.level({chip, 23}) == 1
      assert Safety.disarm(robot) == :ok
      assert Lines.level({chip, 23}) == 0
      assert_raise ErlangError, fn -> GPIO.read(line) end
      :ok = :sys.resume(pid)
    end
  end
end
