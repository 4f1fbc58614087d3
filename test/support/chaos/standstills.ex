defmodule BB.Test.Chaos.Standstills do
  @moduledoc """
  Records the times in which the VM, or one of its schedulers, stood still.

  The kernel may preempt one scheduler's thread while the others run, with all processes that wait
  for that scheduler.
  """

  @tick_ms 5
  @late_ns 3_000_000

  @doc "Starts a watcher on each scheduler, linked to the caller."
  @spec watch() :: [pid()]
  def watch do
    for scheduler <- 1..System.schedulers_online() do
      :erlang.spawn_opt(fn -> watch(now_ns(), []) end, [:link, scheduler: scheduler])
    end
  end

  @doc "Returns the records so far: `[{from_ns, to_ns}]`."
  @spec report([pid()]) :: [{integer(), integer()}]
  def report(watchers) do
    Enum.flat_map(watchers, fn watcher ->
      send(watcher, {:report, self()})
      receive do: ({:standstills, standstills} -> standstills)
    end)
  end

  defp watch(last_ns, standstills) do
    receive do
      {:report, from} ->
        send(from, {:standstills, standstills})
        watch(now_ns(), standstills)
    after
      @tick_ms ->
        now_ns = now_ns()
        due_ns = last_ns + @tick_ms * 1_000_000
        late? = now_ns - due_ns > @late_ns
        watch(now_ns, if(late?, do: [{due_ns, now_ns} | standstills], else: standstills))
    end
  end

  defp now_ns, do: System.monotonic_time(:nanosecond)
end
