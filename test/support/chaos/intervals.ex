defmodule BB.Test.Chaos.Intervals do
  @moduledoc """
  Records the longest intervals between two messages of each sensor, and the standstills of the VM
  or of a scheduler.
  """

  use GenServer

  alias BB.Test.Chaos.Standstills

  @doc "Starts to record. `worth_ns` is the minimum length of an interval of each sensor."
  def start_link(robot, worth_ns), do: GenServer.start_link(__MODULE__, {robot, worth_ns})

  @doc """
  Returns the records: `%{sensor => [{from_ns, to_ns}]}`, and the standstills as `[{from_ns,
  to_ns}]`.
  """
  def report(pid), do: GenServer.call(pid, :report, :infinity)

  @impl GenServer
  def init({robot, worth_ns}) do
    Process.flag(:priority, :high)
    {:ok, _} = BB.subscribe(robot, [:sensor])
    {:ok, %{worth_ns: worth_ns, last: %{}, intervals: %{}, watchers: Standstills.watch()}}
  end

  @impl GenServer
  def handle_info({:bb, [:sensor | path], message}, state) do
    sensor = List.last(path)
    now_ns = message.monotonic_time
    last_ns = Map.get(state.last, sensor, now_ns)
    state = %{state | last: Map.put(state.last, sensor, now_ns)}
    {:noreply, note(state, sensor, last_ns, now_ns)}
  end

  @impl GenServer
  def handle_call(:report, _from, state) do
    {:reply, {state.intervals, Standstills.report(state.watchers)}, state}
  end

  defp note(state, sensor, last_ns, now_ns) do
    if now_ns - last_ns > Map.fetch!(state.worth_ns, sensor),
      do: %{
        state
        | intervals:
            Map.update(state.intervals, sensor, [{last_ns, now_ns}], &[{last_ns, now_ns} | &1])
      },
      else: state
  end
end
