defmodule BB.Command.Supervisor do
  @moduledoc """
  Supervises what executes a robot's commands. `BB.Supervisor` starts it behind a bulkhead.

      BB.Command.Supervisor       rest_for_one
      ├── BB.Command.Dispatcher   decides about each request
      └── BB.CommandSupervisor    BB.Command.Server for each execution

  It owns the table of `BB.Command.Executions`. When the dispatcher dies, all executions end, and
  give their results.
  """
  @moduledoc no_example: "internal: BB.Supervisor starts it"

  use Supervisor

  alias BB.Command.{Dispatcher, Executions}
  alias BB.Process.Successor

  @doc "Starts the processes that execute a robot's commands."
  @spec start_link(module()) :: Supervisor.on_start()
  def start_link(robot), do: Supervisor.start_link(__MODULE__, robot, name: name(robot))

  # With a name, a successor waits for the end of an orphan, which owns the table.
  defp name(robot), do: Module.concat(robot, CommandsSupervisor)

  @impl Supervisor
  def init(robot) do
    Executions.create(robot)

    children = [
      Successor.child_spec({Dispatcher, robot}),
      Successor.child_spec({BB.CommandSupervisor, robot})
    ]

    Supervisor.init(children, strategy: :rest_for_one)
  end
end
