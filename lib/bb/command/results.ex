defmodule BB.Command.Results do
  @kept_ms 60_000

  @moduledoc """
  The results of the commands of all robots. A result is kept for #{div(@kept_ms, 1_000)} s after
  the process of its execution has ended, and given once. `BB.Command.await/2` reads them.

  The results are in an ETS table, in which each execution stores its own. This process owns the
  table, removes old results, and stores the result of an execution that was killed.
  """
  @moduledoc no_example: "internal: BB.Command.await/2 is its interface"

  use GenServer
  use BB.Process.Tolerant

  alias BB.Error.State.CommandCrashed

  @type result :: {:ok, term()} | {:ok, term(), keyword()} | {:error, term()}

  # Rows: {pid, robot, name, :running | {:ended, result}}

  @doc "Starts the process that keeps the results."
  @spec start_link(term()) :: GenServer.on_start()
  def start_link(_arg), do: GenServer.start_link(__MODULE__, [], name: __MODULE__)

  @impl GenServer
  def init(_arg) do
    _table = :ets.new(__MODULE__, [:named_table, :public, read_concurrency: true])
    {:ok, MapSet.new()}
  end

  # The executions

  @doc "Announces the calling process as an execution of a command."
  @spec open(module(), atom()) :: :ok
  def open(robot, name) do
    insert({self(), robot, name, :running})
    GenServer.cast(__MODULE__, {:watch, self()})
  end

  @doc "Stores the result of the calling process, which is about to end."
  @spec put(module(), atom(), result()) :: :ok
  def put(robot, name, result) do
    insert({self(), robot, name, {:ended, result}})
    GenServer.cast(__MODULE__, {:watch, self()})
  end

  # While this process is being restarted nothing is kept. Those who wait have their answer.
  defp insert(row) do
    :ets.insert(__MODULE__, row)
  rescue
    ArgumentError -> false
  end

  @doc "Returns the robot of an execution: `{:ok, robot}`, or `:error` for one that has ended."
  @spec robot(pid()) :: {:ok, module()} | :error
  def robot(pid) do
    case lookup(pid) do
      {_pid, robot, _name, :running} -> {:ok, robot}
      _ended_or_unknown -> :error
    end
  end

  # Waiting

  @doc """
  Waits for the result of an execution: `{:ok, result}`, or `:timeout`.

  The process of the execution gets `{BB.Command.Results, :await, ref}`, and answers
  `{ref, result}` to the alias `ref`.
  """
  @spec await(pid(), timeout()) :: {:ok, result()} | :timeout
  def await(pid, timeout) do
    row = lookup(pid)

    case take(pid) do
      nil -> wait(pid, row, timeout)
      result -> {:ok, result}
    end
  end

  defp wait(pid, row, timeout) do
    ref = :erlang.monitor(:process, pid, alias: :reply_demonitor)
    send(pid, {__MODULE__, :await, ref})

    receive do
      {^ref, result} ->
        _ = take(pid)
        {:ok, result}

      {:DOWN, ^ref, :process, _pid, reason} ->
        {:ok, take(pid) || lost(row, reason)}
    after
      timeout ->
        Process.demonitor(ref, [:flush])
        late(pid, row, ref)
    end
  end

  # A process that has ended may not have been reported yet.
  defp late(pid, row, ref) do
    receive do
      {^ref, result} ->
        _ = take(pid)
        {:ok, result}
    after
      0 -> if alive?(pid), do: :timeout, else: {:ok, take(pid) || lost(row, :noproc)}
    end
  end

  defp alive?(pid), do: node(pid) != node() or Process.alive?(pid)

  # The row of a running execution is left to this module's process.
  defp take(pid) do
    case lookup(pid) do
      {_pid, _robot, _name, {:ended, result}} = row ->
        :ets.delete_object(__MODULE__, row)
        result

      _running_or_unknown ->
        nil
    end
  end

  # The execution was killed, or its result has been given or has been removed.
  defp lost({_pid, _robot, name, :running}, reason),
    do: {:error, %CommandCrashed{command: name, exception: reason}}

  defp lost(_row, reason), do: {:error, {:command_failed, reason}}

  defp lookup(pid) do
    case :ets.lookup(__MODULE__, pid) do
      [row] -> row
      [] -> nil
    end
  rescue
    ArgumentError -> nil
  end

  # The process

  # The state is the set of the processes that are monitored.

  @impl GenServer
  def handle_cast({:watch, pid}, watched) do
    _ = unless pid in watched, do: Process.monitor(pid)
    {:noreply, MapSet.put(watched, pid)}
  end

  @impl GenServer
  def handle_info({:DOWN, _ref, :process, pid, reason}, watched) do
    put_crash(lookup(pid), reason)
    Process.send_after(self(), {:remove, pid}, @kept_ms)
    {:noreply, MapSet.delete(watched, pid)}
  end

  def handle_info({:remove, pid}, watched) do
    :ets.delete(__MODULE__, pid)
    {:noreply, watched}
  end

  defp put_crash({pid, robot, name, :running}, reason) do
    crash = %CommandCrashed{command: name, exception: reason}
    insert({pid, robot, name, {:ended, {:error, crash}}})
  end

  defp put_crash(_row, _reason), do: true
end
