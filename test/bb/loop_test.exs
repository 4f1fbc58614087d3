defmodule BB.LoopTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Unit, only: :sigils

  alias BB.Clock.Stepped
  alias BB.Loop

  doctest BB.Loop

  @bb %{robot: BB.LoopTest.Robot, path: [:base, :imu]}
  @period 20_000_000

  # A loop whose robot has a clock that the test advances.
  defp stepped do
    robot = Module.concat(__MODULE__, "R#{System.unique_integer([:positive])}")
    start_supervised!({Stepped, robot: robot}, id: robot)
    Loop.new(%{robot: robot, path: [:stepped]}, clock: {:rate, 50})
  end

  defp advance(loop, ns), do: Stepped.advance(loop.bb.robot, ns)
  defp now(loop), do: loop.bb.robot |> BB.Clock.of() |> BB.Clock.now_ns()

  defp received_ticks(count \\ 0) do
    receive do
      :tick -> received_ticks(count + 1)
    after
      0 -> count
    end
  end

  defp attach(bb) do
    test = self()
    id = {__MODULE__, bb.path, System.unique_integer()}

    handler = fn _event, measurements, metadata, _config ->
      if metadata.path == bb.path, do: send(test, {:event, measurements, metadata})
    end

    :ok = BB.Telemetry.attach(id, [:bb, :loop, :tick], handler, nil)
    on_exit(fn -> BB.Telemetry.detach(id) end)
  end

  describe "a new loop" do
    test "has a rate in hertz, of a number or a quantity" do
      for rate <- [100, 100.0, ~u(100 hertz), ~u(0.1 kilohertz), ~u(6000 per_minute)] do
        loop = Loop.new(@bb, clock: {:rate, rate})
        assert loop.clock === {:rate, 100.0}
        assert loop.period_ns === 10_000_000
      end

      assert Loop.new(@bb, clock: {:rate, 1000 / 3}).period_ns === 3_000_000
      assert Loop.new(@bb, clock: {:rate, 0.5}).period_ns === 2_000_000_000
      assert Loop.new(@bb, clock: :external).clock == :external
    end

    test "is not armed" do
      before = System.monotonic_time(:nanosecond)

      assert %Loop{
               bb: @bb,
               deadline_ns: deadline_ns,
               last_ns: nil,
               tick_ref: nil,
               ticks: 0,
               skipped: 0
             } = Loop.new(@bb, clock: {:rate, 1000})

      assert deadline_ns in before..System.monotonic_time(:nanosecond)
      assert %{period_ns: nil, deadline_ns: deadline_ns} = Loop.new(@bb, clock: :external)
      assert is_integer(deadline_ns)
      refute_receive :tick, 5
    end

    test "has its robot's clock" do
      loop = stepped()
      assert loop.deadline_ns == now(loop)
    end

    test "needs an owner with robot and path, a clock, and a rate above zero" do
      for bb <- [%{}, %{robot: R}, %{path: []}, nil, [robot: R, path: []]],
          do: assert_raise(FunctionClauseError, fn -> Loop.new(bb, clock: {:rate, 1}) end)

      for rate <- [0, 0.0, -1, ~u(0 hertz), ~u(-5 kilohertz)],
          do: assert_raise(FunctionClauseError, fn -> Loop.new(@bb, clock: {:rate, rate}) end)

      assert_raise KeyError, fn -> Loop.new(@bb, []) end

      for clock <- [{:rate, "1"}, {:rate, nil}, {:rate, ~u(1 meter)}, :internal, 100, nil] do
        error = assert_raise ArgumentError, fn -> Loop.new(@bb, clock: clock) end
        assert error.message =~ "expected :external or {:rate, hertz} as clock"
        assert error.message =~ "got: #{inspect(clock)}"
      end
    end
  end

  describe "arm" do
    test "sends :tick to the caller at each deadline, never before it" do
      loop = Loop.new(@bb, clock: {:rate, 300}) |> Loop.arm()

      Enum.reduce(1..20, loop, fn n, loop ->
        assert_receive :tick, 10_000
        assert System.monotonic_time(:nanosecond) >= loop.deadline_ns
        {dt, skipped, loop} = Loop.tick(loop)
        assert loop.ticks == n
        assert if(n == 1, do: dt == nil, else: is_float(dt) and dt > 0)
        assert skipped >= 0
        loop
      end)
    end

    test "has its deadline a period after the last one" do
      loop = stepped()
      armed = Loop.arm(loop)
      assert armed.deadline_ns == loop.deadline_ns + @period
      assert %{armed | tick_ref: nil, deadline_ns: loop.deadline_ns} == loop
      advance(loop, @period - 1)
      assert received_ticks() == 0
      advance(loop, 1)
      assert received_ticks() == 1
    end

    test "a second time changes nothing" do
      loop = stepped() |> Loop.arm()
      assert Loop.arm(loop) == loop
      advance(loop, @period)
      assert received_ticks() == 1
    end

    test "long after the loop was made keeps its deadlines, and skips nothing" do
      loop = stepped()
      advance(loop, 10 * @period + 5)
      armed = Loop.arm(loop)
      assert armed.deadline_ns == loop.deadline_ns + 11 * @period
      assert armed.skipped == 0
    end
  end

  describe "tick" do
    test "keeps the deadlines, however late each tick is" do
      loop = stepped() |> Loop.arm()
      first = loop.deadline_ns
      advance(loop, @period + 900_000)
      assert {nil, 0, loop} = Loop.tick(loop)
      assert loop.deadline_ns == first + @period
      advance(loop, @period - 800_000)
      assert {dt, 0, loop} = Loop.tick(loop)
      assert_in_delta dt, 0.0192, 1.0e-12
      assert loop.deadline_ns == first + 2 * @period
      assert loop.last_ns == first + @period + 100_000
    end

    test "skips missed periods and counts them" do
      loop = stepped() |> Loop.arm()
      first = loop.deadline_ns
      advance(loop, 4 * @period + 1)
      assert {nil, 3, loop} = Loop.tick(loop)
      assert {loop.deadline_ns, loop.skipped} == {first + 4 * @period, 3}
      advance(loop, 3 * @period - 1)
      assert {_dt, 2, %{skipped: 5, ticks: 2}} = Loop.tick(loop)
    end

    test "after a stall of twenty periods, five ticks are four periods apart" do
      loop = stepped() |> Loop.arm()
      advance(loop, 20 * @period + 1)
      assert received_ticks() == 1
      {nil, 19, loop} = Loop.tick(loop)
      started = now(loop)

      loop =
        Enum.reduce(1..4, loop, fn _, loop ->
          assert received_ticks() == 0
          advance(loop, loop.deadline_ns - now(loop))
          assert received_ticks() == 1
          {_dt, 0, loop} = Loop.tick(loop)
          loop
        end)

      assert now(loop) - started >= 4 * @period - 1
    end

    test "arms the next tick of a loop that was never armed" do
      for wait <- [0, 7 * @period + 3] do
        loop = stepped()
        origin = loop.deadline_ns
        advance(loop, wait)
        skipped = div(wait, @period)
        assert {nil, ^skipped, loop} = Loop.tick(loop)

        loop =
          Enum.reduce(1..10, loop, fn n, loop ->
            assert loop.deadline_ns == origin + (skipped + n) * @period
            advance(loop, loop.deadline_ns - now(loop))
            assert received_ticks() == 1
            assert {dt, 0, loop} = Loop.tick(loop)
            if n > 1, do: assert(dt == 0.02)
            loop
          end)

        assert {loop.ticks, loop.skipped} == {11, skipped}
      end
    end

    test "before its deadline takes the place of the armed one" do
      loop = stepped() |> Loop.arm()
      first = loop.deadline_ns
      assert {nil, 0, loop} = Loop.tick(loop)
      assert loop.deadline_ns == first + @period
      advance(loop, @period)
      assert received_ticks() == 0
      advance(loop, @period)
      assert received_ticks() == 1
      assert {0.04, 0, loop} = Loop.tick(loop)
      assert loop.deadline_ns == first + 2 * @period
    end

    test "many times before its deadline leaves one tick, at most two periods away" do
      loop = stepped() |> Loop.arm()

      {_, _, loop} =
        Enum.reduce(1..100, {nil, 0, loop}, fn _, {_, _, loop} -> Loop.tick(loop) end)

      assert loop.deadline_ns == now(loop) + 2 * @period
      advance(loop, 10 * @period)
      assert received_ticks() == 1
    end

    test "of an external clock is observed now" do
      robot = stepped().bb.robot
      loop = Loop.new(%{robot: robot, path: []}, clock: :external)
      assert {nil, 0, loop} = Loop.tick(loop)
      advance(loop, 500_000_000)
      assert {0.5, 0, %{ticks: 2, tick_ref: nil}} = Loop.tick(loop)
      assert received_ticks() == 0
    end
  end

  describe "cancel" do
    test "removes the timer, and a tick that is in the mailbox, and keeps the deadline" do
      loop = Loop.new(@bb, clock: {:rate, 1_000}) |> Loop.arm()
      assert_receive :tick, 10_000
      send(self(), :tick)
      assert Loop.cancel(loop) == %{loop | tick_ref: nil}
      refute_received :tick
    end

    test "changes nothing where nothing is armed" do
      for loop <- [
            Loop.new(@bb, clock: {:rate, 1}),
            Loop.new(@bb, clock: :external),
            Loop.new(@bb, clock: {:rate, 1}) |> Loop.arm() |> Loop.cancel()
          ] do
        send(self(), :tick)
        assert Loop.cancel(loop) == loop
        assert_received :tick
      end
    end

    test "and arming again continue with the deadlines, and do not tick at once" do
      loop = stepped() |> Loop.arm()
      first = loop.deadline_ns
      advance(loop, @period)
      {nil, 0, loop} = Loop.tick(loop)
      loop = loop |> Loop.cancel() |> Loop.arm()
      assert rem(loop.deadline_ns - first, @period) == 0
      advance(loop, 2_000_000)
      assert received_ticks() == 1
      advance(loop, 2 * @period)
      assert received_ticks() == 1
      assert {_dt, _skipped, %{ticks: 2}} = Loop.tick(loop)
    end

    test "and arming again and again do not put the tick off for ever" do
      loop = stepped() |> Loop.arm()
      loop = Enum.reduce(1..100, loop, fn _, loop -> loop |> Loop.cancel() |> Loop.arm() end)
      assert loop.deadline_ns == now(loop) + 2 * @period
      advance(loop, 10 * @period)
      assert received_ticks() == 1
    end
  end

  describe "observe" do
    test "measures and counts, and sends nothing" do
      loop = Loop.new(@bb, clock: :external)
      assert Loop.arm(loop) == loop
      assert {nil, 0, %{ticks: 1, last_ns: 1_000_000} = loop} = Loop.observe(loop, 1_000_000)
      assert {0.002, 0, loop} = Loop.observe(loop, 3_000_000)
      assert %{ticks: 2, last_ns: 3_000_000, skipped: 0, tick_ref: nil} = loop
      refute_receive :tick, 5
    end

    test "does not count a time that is not after the last one" do
      {nil, 0, loop} = Loop.observe(Loop.new(@bb, clock: :external), -5_000_000)

      for time_ns <- [-5_000_000, -5_000_001, -9_000_000_000],
          do: assert(Loop.observe(loop, time_ns) == {nil, 0, loop})

      assert {0.001, 0, %{ticks: 2}} = Loop.observe(loop, -4_000_000)
    end

    test "takes a message" do
      {:ok, message} =
        BB.Message.new(BB.Message.Sensor.Status, :imu, [state: :up], monotonic_time: 2_000_000_000)

      {nil, 0, loop} = Loop.observe(Loop.new(@bb, clock: :external), 1_000_000_000)
      assert {1.0, 0, %{last_ns: 2_000_000_000}} = Loop.observe(loop, message)
    end

    property "adds up to the time between the first and the last good stamp" do
      forall stamps <- non_empty(list(integer(-50, 50))) do
        {dts, loop} =
          Enum.map_reduce(stamps, Loop.new(@bb, clock: :external), fn stamp, loop ->
            {dt, 0, loop} = Loop.observe(loop, stamp * 1_000_000)
            {dt || 0.0, loop}
          end)

        {highest, records} =
          Enum.reduce(tl(stamps), {hd(stamps), 1}, fn stamp, {highest, count} ->
            if stamp > highest, do: {stamp, count + 1}, else: {highest, count}
          end)

        assert_in_delta Enum.sum(dts), (highest - hd(stamps)) / 1_000, 1.0e-9
        {loop.ticks, loop.last_ns} == {records, highest * 1_000_000}
      end
    end
  end

  describe "the telemetry event" do
    test "has exactly dt, skipped and deadline_error, and none for the first tick" do
      loop = stepped() |> Loop.arm()
      loop = %{loop | bb: %{loop.bb | path: [:base, :told, :rate]}}
      attach(loop.bb)
      advance(loop, @period + 7)
      {nil, 0, loop} = Loop.tick(loop)
      refute_received {:event, _, _}

      advance(loop, 3 * @period)
      assert {0.06, 2, loop} = Loop.tick(loop)
      assert_received {:event, measurements, metadata}
      assert measurements == %{dt: 0.06, skipped: 2, deadline_error: 2 * @period + 7}
      assert metadata == %{robot: loop.bb.robot, path: loop.bb.path, clock: {:rate, 50.0}}

      advance(loop, loop.deadline_ns - now(loop) - 10)
      {_dt, 0, _loop} = Loop.tick(loop)
      assert_received {:event, %{deadline_error: -10, skipped: 0}, _metadata}
    end

    test "of an external clock is for the times that count" do
      bb = %{@bb | path: [:base, :told, :external]}
      attach(bb)
      {nil, 0, loop} = Loop.observe(Loop.new(bb, clock: :external), 1_000_000)
      {nil, 0, loop} = Loop.observe(loop, 1_000_000)
      refute_received {:event, _, _}
      {0.002, 0, _loop} = Loop.observe(loop, 3_000_000)
      assert_received {:event, measurements, metadata}
      assert measurements == %{dt: 0.002, skipped: 0, deadline_error: 0}
      assert metadata == %{robot: bb.robot, path: bb.path, clock: :external}
    end
  end

  # The next tick is handled with a delay of up to five periods. The loop begins armed, with a
  # tick that the process sends to itself, or with a timer of its own.
  property "the deadlines are a grid, and ticks and skipped periods are those that have passed" do
    delays = list(frequency([{3, 0}, {2, integer(0, @period)}, {1, integer(0, 5 * @period)}]))

    forall {start, delays} <- {oneof([:arm, :send, integer(0, 5 * @period)]), delays} do
      loop = stepped()
      origin = loop.deadline_ns

      Enum.reduce(delays, start(start, loop), fn delay, loop ->
        now = now(loop)
        advance(loop, max(loop.deadline_ns - now, 0) + delay)
        assert received_ticks() == 1
        {dt, skipped, next} = Loop.tick(loop)
        assert dt == (loop.last_ns && (now(loop) - loop.last_ns) / 1.0e9)
        assert skipped == div(now(loop) - loop.deadline_ns, @period)
        assert (next.deadline_ns - now(loop)) in 1..@period
        assert next.deadline_ns == origin + (next.ticks + next.skipped + extra(start)) * @period
        next
      end)

      true
    end
  end

  # A tick that was sent, not armed, has the origin as its deadline.
  defp extra(:arm), do: 1
  defp extra(_sent), do: 0

  defp start(:arm, loop), do: Loop.arm(loop)

  defp start(:send, loop) do
    {nil, 0, loop} = Loop.tick(loop)
    loop
  end

  defp start(wait, loop) do
    advance(loop, wait)
    {nil, _skipped, loop} = Loop.tick(loop)
    loop
  end
end
