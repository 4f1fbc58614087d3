defmodule BB.Bus.Sim.Directory do
  @moduledoc """
  Finds the processes of what is simulated by their names: buses in one registry, chips of lines in another.
  """

  @doc "The name under which a process registers itself."
  @spec via(module(), String.t()) :: {:via, module(), {module(), String.t()}}
  def via(registry, name), do: {:via, Registry, {registry, name}}

  # Longer than a registry's bulkhead waits.
  @patience_ms 2_000
  @again_ms 1

  @doc """
  Starts a process by its name. One ends with the registry that has its name; the start of the next
  waits until the registry is there again.
  """
  @spec start_link(module(), term(), module(), String.t()) :: GenServer.on_start()
  def start_link(module, argument, registry, name),
    do: start_link({module, argument, registry, name}, now_ms() + @patience_ms)

  defp start_link({module, argument, registry, name} = start, until_ms) do
    there = Process.whereis(registry)
    started = attempt(fn -> GenServer.start_link(module, argument, name: via(registry, name)) end)

    cond do
      match?({:ok, _pid}, started) or (lasts?(registry, there) and returned?(started)) -> started
      now_ms() > until_ms -> give_up(started)
      true -> start_again(start, until_ms)
    end
  end

  defp start_again(start, until_ms) do
    Process.sleep(@again_ms)
    start_link(start, until_ms)
  end

  # A registry that is not there, or not whole, raises.
  defp attempt(fun) do
    fun.()
  rescue
    error in ArgumentError -> {:raised, error, __STACKTRACE__}
  end

  defp lasts?(registry, there),
    do: is_pid(there) and Process.alive?(there) and Process.whereis(registry) == there

  defp returned?(started), do: not match?({:raised, _error, _stacktrace}, started)

  defp give_up({:raised, error, stacktrace}), do: reraise(error, stacktrace)
  defp give_up(started), do: started

  defp now_ms, do: System.monotonic_time(:millisecond)

  @doc "The process of a name."
  @spec fetch(module(), String.t()) :: {:ok, pid()} | :error
  def fetch(registry, name) do
    case Registry.whereis_name({registry, name}) do
      :undefined -> :error
      pid -> {:ok, pid}
    end
  end

  @doc "The names of the processes that run now, sorted."
  @spec names(module()) :: [String.t()]
  def names(registry) do
    registry
    |> Registry.select([{{:"$1", :_, :_}, [], [:"$1"]}])
    |> Enum.filter(&(fetch(registry, &1) != :error))
    |> Enum.sort()
  end
end
