defmodule BB.ClockTest do
  use ExUnit.Case, async: true

  alias BB.{Clock, Loop}
  alias BB.Clock.Stepped

  doctest BB.Clock
  doctest BB.Clock.Stepped

  defmodule Ticker do
    use GenServer

    def start_link(args), do: GenServer.start_link(__MODULE__, args)

    @impl true
    def init({robot, rate, test}) do
      loop = Loop.new(%{robot: robot, path: [:ticker]}, clock: {:rate, rate})
      {:ok, %{loop: Loop.arm(loop), test: test, ticks: 0}}
    end

    @impl true
    def handle_info(:tick, state) do
      {dt, skipped, loop} = Loop.tick(state.loop)
      send(state.test, {:ticked, dt, skipped})
      {:noreply, %{state | loop: loop, ticks: state.ticks + 1}}
    end

    @impl true
    def handle_call(:ticks, _from, state), do: {:reply, state.ticks, state}
  end

  defp robot, do: Module.concat(__MODULE__, "R#{System.unique_integer([:positive])}")

  test "a robot's clock is the machine's unless one was started for it" do
    assert Clock.of(robot()) == :real
    before = System.monotonic_time(:nanosecond)
    assert Clock.now_ns(:real) in before..System.monotonic_time(:nanosecond)
  end

  test "a message of the machine's clock comes at its time and can be taken back" do
    timer = Clock.send_at(:real, Clock.now_ns(:real) + 3_600_000_000_000, self(), :later)
    assert Clock.cancel(:real, timer)
    Clock.send_at(:real, Clock.now_ns(:real), self(), :now)
    assert_receive :now
    refute_received :later
  end

  test "a message that is recalled never comes, also when it has come already" do
    robot = robot()
    start_supervised!({Stepped, robot: robot})

    for clock <- [:real, Clock.of(robot)] do
      late = Clock.send_at(clock, Clock.now_ns(clock) + 3_600_000_000_000, self(), :late)
      assert Clock.recall(clock, late, :late) == :ok
      come = Clock.send_at(:real, Clock.now_ns(:real), self(), :come)
      assert_receive :come
      send(self(), :come)
      assert Clock.recall(:real, come, :come) == :ok
      refute_received _
    end
  end

  test "a stepped clock stands still between steps" do
    robot = robot()
    start_supervised!({Stepped, robot: robot})
    clock = Clock.of(robot)
    start = Clock.now_ns(clock)
    Clock.send_at(clock, start + 1, self(), :due)
    assert Clock.now_ns(clock) == start
    refute_received :due
  end

  test "messages come in the order of their times, and none beyond the step" do
    robot = robot()
    start_supervised!({Stepped, robot: robot})
    clock = Clock.of(robot)
    {:ok, receiver} = Agent.start_link(fn -> [] end)
    start = Clock.now_ns(clock)

    for at <- [30, 10, 20, 31] do
      update = fn seen -> [{at, Clock.now_ns(clock) - start} | seen] end
      Clock.send_at(clock, start + at, receiver, {:"$gen_cast", {:cast, update}})
    end

    taken = Clock.send_at(clock, start + 15, receiver, :never)
    assert Clock.cancel(clock, taken)
    refute Clock.cancel(clock, taken)

    assert Stepped.advance(robot, 30) == :ok
    assert Agent.get(receiver, & &1) == [{30, 30}, {20, 20}, {10, 10}]
    assert Clock.now_ns(clock) == start + 30
  end

  test "a loop under a stepped clock keeps its rate exactly, each step's ticks handled when the step is over" do
    robot = robot()
    start_supervised!({Stepped, robot: robot})
    ticker = start_supervised!({Ticker, {robot, 300, self()}})

    assert Stepped.advance(robot, 60_000_000_000) == :ok
    assert GenServer.call(ticker, :ticks) == 18_000
    assert_received {:ticked, nil, 0}
    assert_received {:ticked, dt, 0}
    assert_in_delta dt, 1 / 300, 1.0e-9
  end

  test "a receiver that is gone holds up nobody" do
    robot = robot()
    start_supervised!({Stepped, robot: robot})
    clock = Clock.of(robot)
    {:ok, gone} = Agent.start(fn -> nil end)
    Agent.stop(gone)
    Clock.send_at(clock, Clock.now_ns(clock) + 1, gone, :due)
    assert Stepped.advance(robot, 2) == :ok
  end

  test "stepping a robot with the machine's clock raises" do
    assert_raise ArgumentError, ~r/has no stepped clock/, fn -> Stepped.advance(robot(), 1) end
  end

  test "the robot has the machine's clock again when the stepped one ends" do
    robot = robot()
    start_supervised!({Stepped, robot: robot})
    assert %Stepped{} = Clock.of(robot)
    stop_supervised!(Stepped)
    assert Clock.of(robot) == :real
  end

  test "a clock that ends leaves its successor's in place" do
    robot = robot()
    start_supervised!({Stepped, robot: robot}, id: :first)
    start_supervised!({Stepped, robot: robot}, id: :second)
    second = Clock.of(robot)
    stop_supervised!(:first)
    assert Clock.of(robot) == second
    stop_supervised!(:second)
    assert Clock.of(robot) == :real
  end
end
