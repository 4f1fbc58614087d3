defmodule BB.Bus.Sim.Directory do
  @moduledoc """
  Starts and finds the processes of simulated buses and chips by their names.

  `BB.Bus.Sim.Server` has one registry, `BB.Bus.Sim.GPIO.Server` another.
  """
  @moduledoc no_example: "internal: the names of buses and chips are its interface"

  @doc "Returns the name under which a process registers itself."
  @spec via(module(), String.t()) :: {:via, module(), {module(), String.t()}}
  def via(registry, name), do: {:via, Registry, {registry, name}}

  # Longer than a registry takes to restart.
  @timeout_ms 2_000
  @retry_ms 1

  @doc """
  Starts a process with a name, linked to the caller.

  The process ends together with its registry. While the registry restarts, the start waits for
  it.
  """
  @spec start_link(module(), term(), module(), String.t()) :: GenServer.on_start()
  def start_link(module, argument, registry, name),
    do: start_link({module, argument, registry, name}, now_ms() + @timeout_ms)

  defp start_link({module, argument, registry, name} = start, until_ms) do
    found = Process.whereis(registry)
    started = attempt(fn -> GenServer.start_link(module, argument, name: via(registry, name)) end)

    cond do
      match?({:ok, _pid}, started) or (same?(registry, found) and returned?(started)) -> started
      now_ms() > until_ms -> return_or_raise(started)
      true -> retry(start, until_ms)
    end
  end

  defp retry(start, until_ms) do
    Process.sleep(@retry_ms)
    start_link(start, until_ms)
  end

  # A registry that does not run, or not fully, raises.
  defp attempt(fun) do
    fun.()
  rescue
    error in ArgumentError -> {:raised, error, __STACKTRACE__}
  end

  defp same?(registry, found),
    do: is_pid(found) and Process.alive?(found) and Process.whereis(registry) == found

  defp returned?(started), do: not match?({:raised, _error, _stacktrace}, started)

  defp return_or_raise({:raised, error, stacktrace}), do: reraise(error, stacktrace)
  defp return_or_raise(started), do: started

  defp now_ms, do: System.monotonic_time(:millisecond)

  @doc "Returns the process of a name."
  @spec fetch(module(), String.t()) :: {:ok, pid()} | :error
  def fetch(registry, name) do
    case Registry.whereis_name({registry, name}) do
      :undefined -> :error
      pid -> {:ok, pid}
    end
  end

  @doc "Returns the names of the processes that run, sorted."
  @spec names(module()) :: [String.t()]
  def names(registry) do
    registry
    |> Registry.select([{{:"$1", :_, :_}, [], [:"$1"]}])
    |> Enum.filter(&(fetch(registry, &1) != :error))
    |> Enum.sort()
  end
end
