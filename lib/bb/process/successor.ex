defmodule BB.Process.Successor do
  @moduledoc """
  Starts a process anew although the one before it was killed a moment ago. For supervisors and
  registries, which have processes with names below them.

      children = [Successor.child_spec({Registry, keys: :unique, name: MyRegistry})]

  The children of a killed supervisor keep their names until they have ended too. A start that
  meets one of these orphans, or one of their children, waits for its end, instead of failing over
  and over and using up the restarts of the supervisor above. A name that belongs to a process
  whose supervisors all live is taken: the start fails at once.
  """

  @patience_ms 10_000
  @wait_ms 1_000
  @again_ms 1

  @doc "The child specification of `child` with a start that waits for a predecessor's processes."
  @spec child_spec(Supervisor.child_spec() | {module(), term()} | module()) ::
          Supervisor.child_spec()
  def child_spec(child) do
    spec = Supervisor.child_spec(child, [])
    %{spec | start: {__MODULE__, :start_link, [spec.start]}}
  end

  @doc "Starts what the function starts."
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

  # Who has the name that a start has failed for, however deep below it. `:undefined` is one that
  # has ended since.
  defp holder({:error, reason}), do: holder(reason)
  defp holder({:shutdown, {:failed_to_start_child, _id, reason}}), do: holder(reason)
  defp holder({:already_started, pid}), do: pid
  defp holder(_started_or_other), do: nil

  # One of its supervisors is dead when its pid is, or when its name belongs to nobody, or to a
  # process that did not start the next. The first process of all has none.
  defp orphan?(nil), do: false
  defp orphan?(:undefined), do: true

  defp orphan?(pid) do
    case Process.info(pid, [:dictionary, :links]) do
      [dictionary: dictionary, links: links] ->
        parent = dictionary |> Keyword.get(:"$ancestors", []) |> List.first()
        parent != nil and deserted?(process(parent), links)

      nil ->
        true
    end
  end

  defp deserted?(parent, links), do: parent not in links or orphan?(parent)

  defp process(name) when is_atom(name), do: Process.whereis(name)
  defp process(pid), do: pid

  # One that is ending has its name for a little longer than it can be watched.
  defp await_end(holder) do
    if is_pid(holder), do: await_down(holder)
    Process.sleep(@again_ms)
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
