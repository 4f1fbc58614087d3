defmodule BB.Bus.I2C.Supervisor do
  @moduledoc """
  Supervises the processes of shared buses, each of which starts with the first
  `BB.Bus.I2C.open/2`.

      BB.Bus.I2C.Supervisor        rest_for_one
      ├── BB.Bus.I2C.Registry      finds them by backend and name
      └── BB.Bus.I2C.Servers       a BB.Bus.I2C.Server for each open bus

  A process that dies is not restarted, because its handles are lost with it. The next `open/2`
  starts a new one.
  """
  @moduledoc no_example: "internal: BB.Bus.I2C is its interface"

  use Supervisor

  alias BB.Bus.I2C.Server
  alias BB.Process.Successor

  @registry BB.Bus.I2C.Registry
  @servers BB.Bus.I2C.Servers

  # Kills of these processes must not end the buses for good.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  @doc false
  def start_link(_opts), do: Supervisor.start_link(__MODULE__, nil, name: __MODULE__)

  @doc "Returns the name of the registry of bus processes."
  @spec registry() :: module()
  def registry, do: @registry

  @doc """
  Returns whether bus processes can be started.

  `:restarting` lasts for a moment, or for good after the application has ended. `:ending` is for
  good, because a supervisor above has died.
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
