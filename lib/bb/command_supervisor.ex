defmodule BB.CommandSupervisor do
  @moduledoc """
  The supervisor of the executions of a robot's commands, a `DynamicSupervisor`. Use its name to
  find it among the processes of a robot; `BB.Robot.Runtime.executing_commands/1` lists the
  executions.

      pid = BB.Process.whereis(MyRobot, BB.CommandSupervisor)
      DynamicSupervisor.count_children(pid).active
  """

  use DynamicSupervisor

  alias BB.Command.Dispatcher
  alias BB.Supervisor.Name

  @doc "Starts the supervisor of a robot."
  @spec start_link(module()) :: Supervisor.on_start()
  def start_link(robot),
    do: DynamicSupervisor.start_link(__MODULE__, robot, name: Dispatcher.supervisor(robot))

  @impl DynamicSupervisor
  def init(robot) do
    Name.register(robot, __MODULE__)
    DynamicSupervisor.init(strategy: :one_for_one)
  end
end
