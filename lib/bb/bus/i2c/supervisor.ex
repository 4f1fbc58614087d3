defmodule BB.Bus.I2C.Supervisor do
  @moduledoc """
  Where the processes of shared buses live. They are started when they are needed; one that dies
  has taken its handles along, so it is not started again before somebody opens the bus.

      BB.Bus.I2C.Supervisor        rest_for_one
      ├── BB.Bus.I2C.Registry      finds them by backend and name
      └── BB.Bus.I2C.Servers       a BB.Bus.I2C.Server for each open bus
  """
  use Supervisor

  alias BB.Bus.I2C.Server
  alias BB.Process.Successor

  @registry BB.Bus.I2C.Registry
  @servers BB.Bus.I2C.Servers

  # However often they are killed, the buses of the others come back.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  @doc false
  def start_link(_opts), do: Supervisor.start_link(__MODULE__, nil, name: __MODULE__)

  @doc "The registry of bus processes, by backend and name."
  @spec registry() :: module()
  def registry, do: @registry

  @doc """
  Whether bus processes can be had: `:restarting` is over in a moment, unless the application has
  ended, and `:ending` is not, as what stands above them has died.
  """
  @spec state() :: :running | :restarting | :ending
  def state do
    servers = Process.whereis(@servers)

    case servers && Process.info(servers, :dictionary) do
      {:dictionary, dictionary} -> if orphan?(dictionary), do: :ending, else: :running
      nil -> :restarting
    end
  end

  defp orphan?(dictionary),
    do: dictionary |> Keyword.get(:"$ancestors", []) |> Enum.any?(&(not living?(&1)))

  defp living?(name) when is_atom(name), do: Process.whereis(name) != nil
  defp living?(pid), do: Process.alive?(pid)

  @doc "Starts the process of a bus."
  @spec start_server(Server.key(), BB.Clock.t()) :: DynamicSupervisor.on_start_child()
  def start_server(key, clock),
    do: DynamicSupervisor.start_child(@servers, {Server, {key, clock}})

  @impl Supervisor
  def init(nil) do
    Supervisor.init(
      [
        Successor.child_spec({Registry, keys: :unique, name: @registry}),
        Successor.child_spec({DynamicSupervisor, name: @servers})
      ],
      [strategy: :rest_for_one] ++ @restarts
    )
  end
end
