defmodule BB.Test.Chaos.Core.Watch do
  @moduledoc """
  Checks every millisecond whether a robot is armed and has a warden, and records the times
  without one.
  """

  alias BB.Test.Chaos.Standstills

  @look_ms 1

  @doc "Starts to check."
  @spec start_link([module()]) :: {:ok, pid()}
  def start_link(robots) do
    watch = fn ->
      Process.flag(:priority, :high)
      look(%{robots: robots, since: %{}, intervals: [], standstills: Standstills.watch()})
    end

    {:ok, spawn_link(watch)}
  end

  @doc "Returns the records: `{[{robot, from_ns, to_ns}], standstills}`."
  @spec report(pid()) :: {[{module(), integer(), integer()}], [{integer(), integer()}]}
  def report(watch) do
    send(watch, {:report, self()})
    receive do: ({:intervals, intervals, standstills} -> {intervals, standstills})
  end

  @doc "Tells whether the robot is armed, as far as that can be determined."
  @spec armed?(module()) :: boolean()
  def armed?(robot) do
    BB.Safety.armed?(robot)
  rescue
    ArgumentError -> false
  end

  @doc "Tells whether the robot has a living warden."
  @spec warden?(module()) :: boolean()
  def warden?(robot), do: robot |> Module.concat(Safety) |> Process.whereis() |> is_pid()

  defp look(state) do
    now_ns = System.monotonic_time(:nanosecond)
    state = Enum.reduce(state.robots, state, &look(&1, &2, now_ns))

    receive do
      {:report, from} ->
        open = for {robot, from_ns} <- state.since, do: {robot, from_ns, now_ns}
        standstills = Standstills.report(state.standstills)
        send(from, {:intervals, open ++ state.intervals, standstills})
        look(state)
    after
      @look_ms -> look(state)
    end
  end

  defp look(robot, %{since: since} = state, now_ns) do
    unwatched? = not warden?(robot) and armed?(robot)

    case since do
      %{^robot => from_ns} when not unwatched? ->
        interval = {robot, from_ns, now_ns}
        %{state | since: Map.delete(since, robot), intervals: [interval | state.intervals]}

      _none when unwatched? ->
        %{state | since: Map.put_new(since, robot, now_ns)}

      _watched ->
        state
    end
  end
end
