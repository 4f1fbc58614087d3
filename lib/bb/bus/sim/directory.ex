defmodule BB.Bus.Sim.Directory do
  @moduledoc """
  Finds the processes of what is simulated by their names: buses in one registry, chips of lines in another.
  """

  @doc "The name under which a process registers itself."
  @spec via(module(), String.t()) :: {:via, module(), {module(), String.t()}}
  def via(registry, name), do: {:via, Registry, {registry, name}}

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
