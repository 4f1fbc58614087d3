defmodule BB.Test.Chaos.Intervals do
  @moduledoc """
  Listens to all sensors of a robot and notes the longest intervals between two messages of one; and when the VM itself stood still, or one of its schedulers.
  """

  use GenServer

  @tick_ms 5
  @late_ns 3_000_000

  @doc "Starts to listen. `worth_ns` has for each sensor from what length on an interval is noted."
  def start_link(robot, worth_ns), do: GenServer.start_link(__MODULE__, {robot, worth_ns})

  @doc "What was noted: `%{sensor => [{from_ns, to_ns}]}`, and the standstills as `[{from_ns, to_ns}]`."
  def report(pid), do: GenServer.call(pid, :report, :infinity)

  @impl GenServer
  def init({robot, worth_ns}) do
    Process.flag(:priority, :high)
    {:ok, _} = BB.subscribe(robot, [:sensor])
    {:ok, %{worth_ns: worth_ns, last: %{}, intervals: %{}, watchers: watchers()}}
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
    {:reply, {state.intervals, Enum.flat_map(state.watchers, &standstills/1)}, state}
  end

  # The kernel may take one scheduler's thread away while the others run on, with all the processes that wait for it.
  defp watchers do
    for scheduler <- 1..System.schedulers_online() do
      :erlang.spawn_opt(fn -> watch(System.monotonic_time(:nanosecond), []) end, [
        :link,
        scheduler: scheduler
      ])
    end
  end

  defp standstills(watcher) do
    send(watcher, {:report, self()})

    receive do
      {:standstills, standstills} -> standstills
    end
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

  defp watch(last_ns, standstills) do
    receive do
      {:report, from} ->
        send(from, {:standstills, standstills})
        watch(System.monotonic_time(:nanosecond), standstills)
    after
      @tick_ms ->
        now_ns = System.monotonic_time(:nanosecond)
        due_ns = last_ns + @tick_ms * 1_000_000

        if now_ns - due_ns > @late_ns,
          do: watch(now_ns, [{due_ns, now_ns} | standstills]),
          else: watch(now_ns, standstills)
    end
  end
end
