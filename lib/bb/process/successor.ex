defmodule BB.Process.Successor do
  @moduledoc """
  Starts a process anew although the one before it was killed a moment ago. For supervisors and
  registries, which have processes with names below them.

      children = [Successor.child_spec({Registry, keys: :unique, name: MyRegistry})]

  The children of a killed supervisor keep their names until they have ended too. A start that
  meets one of these orphans waits for its end, instead of failing over and over and using up the
  restarts of the supervisor above. A name that belongs to a process with a living parent is
  taken: the start fails at once.
  """

  @tries 10
  @wait_ms 1_000

  @doc "The child specification of `child` with a start that waits for a predecessor's processes."
  @spec child_spec(Supervisor.child_spec() | {module(), term()} | module()) ::
          Supervisor.child_spec()
  def child_spec(child) do
    spec = Supervisor.child_spec(child, [])
    %{spec | start: {__MODULE__, :start_link, [spec.start]}}
  end

  @doc "Starts what the function starts."
  @spec start_link({module(), atom(), [term()]}) :: Supervisor.on_start()
  def start_link(start), do: start_link(start, @tries)

  defp start_link({module, function, arguments} = start, tries) do
    started = apply(module, function, arguments)
    holder = holder(started)

    if tries > 1 and is_pid(holder) and orphan?(holder) do
      await_end(holder)
      start_link(start, tries - 1)
    else
      started
    end
  end

  # Who has the name that a start has failed for, however deep below it.
  defp holder({:error, reason}), do: holder(reason)
  defp holder({:shutdown, {:failed_to_start_child, _id, reason}}), do: holder(reason)
  defp holder({:already_started, pid}), do: pid
  defp holder(_started_or_other), do: nil

  # Its parent is dead when its pid is, or when its name belongs to nobody, or to a process that
  # did not start it.
  defp orphan?(pid) do
    case Process.info(pid, [:dictionary, :links]) do
      [dictionary: dictionary, links: links] ->
        parent = dictionary |> Keyword.get(:"$ancestors", []) |> List.first() |> process()
        parent not in links or not Process.alive?(parent)

      nil ->
        true
    end
  end

  defp process(name) when is_atom(name), do: Process.whereis(name)
  defp process(pid), do: pid

  defp await_end(pid) do
    ref = Process.monitor(pid)

    receive do
      {:DOWN, ^ref, :process, ^pid, _reason} -> :ok
    after
      @wait_ms -> Process.demonitor(ref, [:flush])
    end
  end
end
