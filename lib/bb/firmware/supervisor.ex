defmodule BB.Firmware.Supervisor do
  @moduledoc """
  Supervises the processes that guard a robot's firmware, apart from the robot.

      BB.Firmware.Supervisor         one_for_one
      ├── BB.Firmware.Provisioning   runs once, leaves no process
      ├── BB.Firmware.Guard          each with a bulkhead of its own
      ├── BB.Firmware.Gate
      └── BB.Firmware.Network

  No child, and no robot, spends the restarts of another (`BB.Process.Bulkhead`). The
  configuration has the options of each child under its name:

      config :ganglion, BB.Firmware.Guard, reach: :lan
  """

  use Supervisor

  alias BB.Firmware.{Gate, Guard, Network, Provisioning}
  alias BB.Process.Bulkhead

  @restarts [max_restarts: 1_000, max_seconds: 1]

  @doc "Starts the supervisor for `robot:`, with the name `name:`."
  @spec start_link(robot: module(), name: atom()) :: Supervisor.on_start()
  def start_link(opts) do
    opts = Keyword.validate!(opts, [:robot, name: __MODULE__])
    Supervisor.start_link(__MODULE__, opts[:robot], name: opts[:name])
  end

  @impl Supervisor
  def init(robot) do
    watchers =
      for module <- [Guard, Gate, Network],
          do: Bulkhead.child_spec({module, [robot: robot] ++ configured(module)})

    Supervisor.init([Provisioning | watchers], [strategy: :one_for_one] ++ @restarts)
  end

  defp configured(module), do: Application.get_env(:ganglion, module, [])
end
