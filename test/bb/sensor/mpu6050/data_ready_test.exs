defmodule BB.Sensor.Mpu6050.DataReadyTest do
  use ExUnit.Case, async: true

  import BB.Test.Bench, only: [reason_of_end: 1]
  import BB.Test.Eventually

  alias BB.Bus.Sim
  alias BB.Clock.Stepped
  alias BB.Message.Sensor.Imu
  alias BB.Sensor.Mpu6050

  doctest BB.Sensor.Mpu6050.DataReady

  @ms 1_000_000

  # On the machine's clock, a sample each 50 ms, so that the FIFO has room while the machine
  # stalls.
  @slow [rate: 20, filter: 5]
  @patience_ms 60_000

  setup context do
    name = "mpu-int-#{System.unique_integer([:positive])}"
    robot = Module.concat(__MODULE__, name)
    if context[:stepped], do: start_supervised!({Stepped, robot: robot})
    clock = BB.Clock.of(robot)
    start_supervised!({BB.PubSub, robot})
    {:ok, _} = BB.PubSub.subscribe(robot, [:sensor])
    start_supervised!({Sim.Lines, chips: %{name => [clock: clock] ++ lines(context)}})

    opts = [source: &slope/1, reset_ms: 0, interrupt: {name, 4}]
    device = {Sim.Mpu6050, Keyword.merge(opts, Map.get(context, :device, []))}
    start_supervised!({Sim, buses: %{name => [devices: %{0x68 => device}, clock: clock]}})
    %{robot: robot, name: name, clock: clock, pin: {name, 4}}
  end

  # The kernel's clock is not Erlang's.
  defp lines(%{stepped: true}), do: []
  defp lines(_context), do: [timestamp_offset_ns: 77_000_000_000]

  # One step of the ±16 g range a millisecond, so that a sample shows its time.
  defp slope(seconds) do
    %{
      acceleration: {seconds * 1000 * 9.80665 / 2048, 0.0, 9.8},
      angular_velocity: {0.0, 0.0, 0.0},
      temperature: 25.0
    }
  end

  defp args(context, opts) do
    defaults = [
      bus: context.name,
      rate: 1000,
      filter: 184,
      accel_range: 16,
      interrupt: context.pin
    ]

    [__callback_module__: Mpu6050, bb: %{robot: context.robot, path: [:imu]}] ++
      Keyword.merge(defaults, opts)
  end

  defp start(context, opts) do
    spec = {BB.Sensor.Server, args(context, opts)}
    start_supervised(Supervisor.child_spec(spec, id: :imu, restart: :temporary))
  end

  defp start!(context, opts) do
    {:ok, pid} = start(context, opts)
    pid
  end

  # Its start waits for an edge, which comes when time passes.
  defp start_stepped!(context, opts) do
    passing = Task.async(fn -> pass(context.robot) end)
    pid = start!(context, opts)
    send(passing.pid, :stop)
    :ok = Task.await(passing, :infinity)
    :sys.get_state(pid)
    pid
  end

  defp pass(robot) do
    receive do
      :stop -> :ok
    after
      # A driver that gets no turn between two steps finds its FIFO, of 73 samples, overflowed.
      20 ->
        Stepped.advance(robot, @ms)
        pass(robot)
    end
  end

  defp receive_imu do
    assert_receive {:bb, [:sensor, :imu], %{payload: %Imu{}} = message}, @patience_ms
    message
  end

  defp messages do
    receive do
      {:bb, [:sensor, :imu], message} -> [message | messages()]
    after
      0 -> []
    end
  end

  defp step(message), do: round(message.payload.linear_acceleration.x * 2048 / 9.80665)

  describe "with the FIFO" do
    @tag stepped: true
    test "a second at 1 kHz is 1000 messages, each the next sample with the time of its edge",
         context do
      pid = start_stepped!(context, fifo: true)
      Stepped.advance(context.robot, 20 * @ms, settle: [pid])
      messages()
      Stepped.advance(context.robot, 1_000 * @ms, settle: [pid])
      messages = messages()
      assert length(messages) == 1000
      assert steps_by?(messages, 1)
      times = Enum.map(messages, & &1.monotonic_time)
      assert List.last(times) - hd(times) == 999 * @ms
      assert Enum.chunk_every(times, 2, 1, :discard) |> Enum.all?(fn [a, b] -> b - a == @ms end)
    end

    @tag stepped: true
    test "none is lost while the sensor is held up for 60 ms", context do
      pid = start_stepped!(context, fifo: true)
      Stepped.advance(context.robot, 20 * @ms, settle: [pid])
      messages()
      :sys.suspend(pid)
      Stepped.advance(context.robot, 60 * @ms)
      :sys.resume(pid)
      Stepped.advance(context.robot, 20 * @ms, settle: [pid])
      messages = messages()
      assert length(messages) == 80
      assert steps_by?(messages, 1)

      assert Enum.all?(
               messages,
               &(rem(&1.monotonic_time - hd(messages).monotonic_time, @ms) == 0)
             )
    end

    test "none is lost on the machine's clock, and the times are by Erlang's clock", context do
      before_ns = System.monotonic_time(:nanosecond)
      start!(context, [fifo: true] ++ @slow)
      messages = for _ <- 1..30, do: receive_imu()
      assert steps_by?(messages, 50)
      times = Enum.map(messages, & &1.monotonic_time)
      assert List.last(times) in before_ns..System.monotonic_time(:nanosecond)
      assert times == Enum.sort(times) and times == Enum.uniq(times)
    end

    test "none is lost when a transfer fails now and then", context do
      start!(context, [fifo: true] ++ @slow)

      messages =
        for n <- 1..30 do
          if rem(n, 10) == 0, do: Sim.fault(context.name, 0x68, {:nak, 2})
          receive_imu()
        end

      assert steps_by?(messages, 50)
    end

    @tag stepped: true
    test "an overflow ends it with the reason", context do
      pid = start_stepped!(context, fifo: true)
      :sys.suspend(pid)
      Stepped.advance(context.robot, 200 * @ms)
      messages()
      monitor = Process.monitor(pid)
      :sys.resume(pid)
      assert_receive {:DOWN, ^monitor, :process, ^pid, reason}, @patience_ms
      assert reason == {:shutdown, {:overflow, context.name, 0x68}}
      assert messages() == []
      assert Mpu6050.explain({:overflow, context.name, 0x68}) =~ "0x68 on #{context.name}"
    end

    defp steps_by?(messages, step) do
      [first | _] = steps = Enum.map(messages, &step/1)
      steps == for(n <- 0..(length(steps) - 1), do: first + n * step)
    end
  end

  describe "without the FIFO" do
    @tag stepped: true
    test "each message is a new sample with the time of its edge", context do
      pid = start_stepped!(context, rate: 200)
      Stepped.advance(context.robot, 20 * @ms, settle: [pid])
      messages()
      Stepped.advance(context.robot, 500 * @ms, settle: [pid])
      messages = messages()
      assert length(messages) == 100
      started_ns = hd(messages).monotonic_time

      for {message, n} <- Enum.with_index(messages) do
        assert message.monotonic_time - started_ns == n * 5 * @ms
        assert step(message) == step(hd(messages)) + n * 5
      end
    end

    @tag stepped: true
    test "noise on the line makes no message of an old sample", context do
      pid = start_stepped!(context, rate: 10, filter: 5)
      Stepped.advance(context.robot, 200 * @ms, settle: [pid])
      messages()

      for _ <- 1..20, level <- [1, 0], do: Sim.Lines.drive(context.pin, level)
      :sys.get_state(pid)
      Sim.Lines.release(context.pin)
      assert messages() == []
      Stepped.advance(context.robot, 100 * @ms, settle: [pid])
      assert [_message] = messages()
    end
  end

  describe "a line" do
    test "that is cut ends it, and does not let it start", context do
      pid = start!(context, [fifo: true] ++ @slow)
      receive_imu()
      Sim.Lines.fault(context.pin, :cut)
      reason = {:no_interrupt, context.pin, context.name, 0x68}
      assert reason_of_end(pid) == {:shutdown, reason}
      assert {:error, {^reason, _child}} = start(context, @slow)
      Sim.Lines.clear(context.pin)
      assert {:ok, _pid} = start(context, @slow)
      assert Mpu6050.explain(reason) =~ "line 4 of #{context.name}"
    end

    test "that does not exist does not let it start, and gives the bus back", context do
      reason = {:line_not_found, {"gpiochip-none", 4}}
      assert {:error, {^reason, _child}} = start(context, interrupt: {"gpiochip-none", 4})
      assert eventually(fn -> not Enum.any?(BB.Bus.I2C.health(), &(&1.bus == context.name)) end)
      assert Mpu6050.explain(reason) =~ "gpiochip-none"
    end

    test "is closed", context do
      pid = start!(context, @slow)
      receive_imu()
      assert Sim.Lines.describe(context.pin).open?
      stop_supervised!(:imu)
      refute Process.alive?(pid)
      refute Sim.Lines.describe(context.pin).open?
    end
  end

  describe "a chip" do
    test "that was without power for a moment, and pulses no more, ends it", context do
      pid = start!(context, [fifo: true] ++ @slow)
      receive_imu()
      Sim.unplug(context.name, 0x68)
      Sim.replug(context.name, 0x68)
      assert reason_of_end(pid) == {:shutdown, {:restarted, context.name, 0x68}}
    end

    test "that is unplugged ends it, and the reason is not its line", context do
      pid = start!(context, @slow)
      receive_imu()
      Sim.unplug(context.name, 0x68)
      assert reason_of_end(pid) == {:shutdown, {:no_answer, context.name, 0x68}}
    end
  end

  test "it declares the rate of the chip" do
    assert Mpu6050.rate(rate: 300, filter: 44, interrupt: nil) == 300
    assert_in_delta Mpu6050.rate(rate: 300, filter: 44, interrupt: {"gpiochip0", 4}), 333.3, 0.1
  end
end
