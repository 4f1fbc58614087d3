defmodule BB.LoopTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Unit, only: :sigils

  alias BB.Loop

  doctest BB.Loop

  @bb %{robot: BB.LoopTest.Robot, path: [:base, :imu]}
  @period 1_000_000

  # A loop whose deadline is known to the test, and whose timer does not fire.
  defp armed(deadline_ns) do
    loop = Loop.new(@bb, clock: {:rate, 1_000})
    %{loop | deadline_ns: deadline_ns, tick_ref: make_ref()}
  end

  test "a rate is a number of hertz or a quantity" do
    assert Loop.new(@bb, clock: {:rate, 100}).period_ns == 10_000_000
    assert Loop.new(@bb, clock: {:rate, 0.5}).period_ns == 2_000_000_000
    assert Loop.new(@bb, clock: {:rate, ~u(2 kilohertz)}).period_ns == 500_000
  end

  test "a new loop has its fields and is not armed" do
    assert %Loop{
             bb: @bb,
             clock: {:rate, 100},
             deadline_ns: nil,
             last_ns: nil,
             tick_ref: nil,
             ticks: 0,
             skipped: 0
           } = Loop.new(@bb, clock: {:rate, 100})
  end

  test "a clock that is none raises, saying what was given" do
    for clock <- [{:rate, 0}, {:rate, -1}, {:rate, "1"}, {:rate, ~u(1 meter)}, :internal, 100] do
      error = assert_raise ArgumentError, fn -> Loop.new(@bb, clock: clock) end
      assert error.message =~ "got: #{inspect(clock)}"
    end

    assert_raise ArgumentError, ~r/expected clock: .* got: \[\]/, fn -> Loop.new(@bb, []) end
  end

  test "an armed loop sends :tick to the caller, never before its deadline" do
    loop = Loop.new(@bb, clock: {:rate, 300}) |> Loop.arm()

    Enum.reduce(1..20, loop, fn n, loop ->
      assert_receive :tick
      assert System.monotonic_time(:nanosecond) >= loop.deadline_ns
      {dt, skipped, loop} = Loop.tick(loop)
      assert loop.ticks == n
      assert if(n == 1, do: dt == nil, else: dt > 0)
      assert skipped >= 0
      loop
    end)
  end

  test "arming twice makes no second timer" do
    loop = Loop.new(@bb, clock: {:rate, 1_000}) |> Loop.arm()
    assert Loop.arm(loop) == loop
  end

  test "deadlines stay on the grid that arming set, however late a tick is" do
    loop = armed(5 * @period)
    {nil, 0, loop} = Loop.observe(loop, 5 * @period + 900_000)
    assert loop.deadline_ns == 6 * @period
    {dt, 0, loop} = Loop.observe(loop, 6 * @period + 100_000)
    assert_in_delta dt, 0.0002, 1.0e-9
    assert loop.deadline_ns == 7 * @period
  end

  test "missed periods are skipped and counted" do
    {nil, 3, loop} = Loop.observe(armed(5 * @period), 8 * @period + 1)
    assert loop.deadline_ns == 9 * @period
    assert {_, 2, %{skipped: 5, ticks: 2}} = Loop.observe(loop, 11 * @period)
  end

  test "a tick before its deadline leaves the next one armed" do
    loop = armed(5 * @period)
    assert {nil, 0, early} = Loop.observe(loop, 4 * @period)
    assert {early.deadline_ns, early.tick_ref} == {loop.deadline_ns, loop.tick_ref}
  end

  test "a cancelled loop sends no tick, not even one that is in the mailbox" do
    loop = Loop.new(@bb, clock: {:rate, 1_000}) |> Loop.arm()
    assert_receive :tick
    send(self(), :tick)
    assert %{tick_ref: nil, deadline_ns: nil} = loop = Loop.cancel(loop)
    refute_received :tick
    assert Loop.cancel(loop) == loop
  end

  test "a cancelled loop can be armed again" do
    loop = Loop.new(@bb, clock: {:rate, 1_000}) |> Loop.arm() |> Loop.cancel() |> Loop.arm()
    assert_receive :tick
    assert {nil, _, _} = Loop.tick(loop)
  end

  test "an external clock sends nothing; the loop measures and counts" do
    loop = Loop.new(@bb, clock: :external)
    assert Loop.arm(loop) == loop
    assert {nil, 0, loop} = Loop.observe(loop, 1_000_000_000)
    assert {0.5, 0, loop} = Loop.observe(loop, 1_500_000_000)
    assert %{ticks: 2, tick_ref: nil, deadline_ns: nil} = loop
  end

  test "an observed message counts with its own time" do
    {:ok, message} =
      BB.Message.new(BB.Message.Sensor.Status, :imu, [state: :up], monotonic_time: 2_000_000_000)

    {nil, 0, loop} = Loop.observe(Loop.new(@bb, clock: :external), 1_000_000_000)
    assert {1.0, 0, %{last_ns: 2_000_000_000}} = Loop.observe(loop, message)
  end

  test "each tick is a telemetry event" do
    test = self()

    handler = fn event, measurements, metadata, _ ->
      send(test, {event, measurements, metadata})
    end

    bb = %{@bb | path: [:base, :told]}

    BB.Telemetry.attach(
      __MODULE__,
      [:bb, :loop, :tick],
      fn event, measurements, metadata, _ ->
        if metadata.path == bb.path, do: handler.(event, measurements, metadata, nil)
      end,
      nil
    )

    on_exit(fn -> BB.Telemetry.detach(__MODULE__) end)
    {nil, 2, loop} = Loop.observe(%{armed(5 * @period) | bb: bb}, 7 * @period)

    assert_received {[:bb, :loop, :tick], first,
                     %{robot: BB.LoopTest.Robot, path: [:base, :told]}}

    assert first == %{dt_ns: nil, late_ns: 2 * @period, skipped: 2}
    Loop.observe(loop, 8 * @period)
    assert_received {_, %{dt_ns: @period, late_ns: 0, skipped: 0}, _}
  end

  property "ticks and skipped periods together are the deadlines that have passed" do
    forall delays <- list(integer(0, 5_000_000)) do
      {loop, _now} =
        Enum.reduce(delays, {armed(@period), @period}, fn delay, {loop, now} ->
          now = max(now, loop.deadline_ns) + delay
          {_, _, loop} = Loop.observe(loop, now)
          {loop, now}
        end)

      Loop.cancel(loop)
      loop.deadline_ns == (loop.ticks + loop.skipped + 1) * @period
    end
  end
end
