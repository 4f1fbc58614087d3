defmodule BB.Process.Successor do
  @moduledoc """
  Starts a process whose predecessor was killed a moment ago.

  Use it for supervisors and registries, which have processes with names below them:

      children = [Successor.child_spec({Registry, keys: :unique, name: MyRegistry})]

  The children of a killed supervisor keep their names until they have ended too. A start that
  finds a name taken by one of these orphans waits for the orphan's end. Otherwise it would fail
  repeatedly and spend the restarts of the supervisor above. If all supervisors of the process
  that has the name are alive, the start fails at once.
  """

  @patience_ms 10_000
  @wait_ms 1_000
  @retry_ms 1

  @doc "Returns the child specification of `child` with a start that waits for orphans."
  @spec child_spec(Supervisor.child_spec() | {module(), term()} | module()) ::
          Supervisor.child_spec()
  def child_spec(child) do
    spec = Supervisor.child_spec(child, [])
    %{spec | start: {__MODULE__, :start_link, [spec.start]}}
  end

  @doc "Starts a process by calling the function, again after each orphan that it has waited for."
  @spec start_link({module(), atom(), [term()]}) :: Supervisor.on_start()
  def start_link(start), do: start_link(start, now_ms() + @patience_ms)

  defp start_link({module, function, arguments} = start, until_ms) do
    started = apply(module, function, arguments)

    if orphan?(holder(started)) and now_ms() < until_ms do
      await_end(holder(started))
      start_link(start, until_ms)
    else
      started
    end
  end

  # The process that has the name for which a start failed, however deep below it. It is
  # `:undefined` if that process has ended since.
  defp holder({:error, reason}), do: holder(reason)
  defp holder({:shutdown, {:failed_to_start_child, _id, reason}}), do: holder(reason)
  defp holder({:already_started, pid}), do: pid
  defp holder(_started_or_other), do: nil

  # A supervisor is dead if its pid is, or if its name belongs to no process or to one that is not
  # linked to the next. The first process of all has no supervisor.
  defp orphan?(nil), do: false
  defp orphan?(:undefined), do: true

  defp orphan?(pid) do
    case Process.info(pid, [:dictionary, :links]) do
      [dictionary: dictionary, links: links] ->
        parent = dictionary |> Keyword.get(:"$ancestors", []) |> List.first()
        parent != nil and dead_or_unlinked?(process(parent), links)

      nil ->
        true
    end
  end

  defp dead_or_unlinked?(parent, links), do: parent not in links or orphan?(parent)

  defp process(name) when is_atom(name), do: Process.whereis(name)
  defp process(pid), do: pid

  # A process that ends keeps its name a little longer than a monitor shows.
  defp await_end(holder) do
    if is_pid(holder), do: await_down(holder)
    Process.sleep(@retry_ms)
  end

  defp await_down(pid) do
    ref = Process.monitor(pid)

    receive do
      {:DOWN, ^ref, :process, ^pid, _reason} -> :ok
    after
      @wait_ms -> Process.demonitor(ref, [:flush])
    end
  end

  defp now_ms, do: System.monotonic_time(:millisecond)
end
