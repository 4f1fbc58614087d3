defmodule BB.Supervisor.Tasks do
  @moduledoc """
  Supervises tasks of a robot, for anybody: a `Task.Supervisor` under the name
  `BB.TaskSupervisor` in the robot's registry. The tasks end with the robot.

      name = BB.Process.via(MyRobot, BB.TaskSupervisor)
      Task.Supervisor.start_child(name, fn -> calibrate() end)

  A process beside it ends with the registry, and takes it along, so that it is started again with
  its name.
  """

  use Supervisor

  defmodule RegistryLink do
    @moduledoc "A process that ends with the registry of a robot."
    @moduledoc no_example: "internal: BB.Supervisor.Tasks starts it"

    use GenServer
    use BB.Process.Tolerant

    @doc "Starts the process. It fails while the registry does not run."
    @spec start_link(module()) :: GenServer.on_start()
    def start_link(robot), do: GenServer.start_link(__MODULE__, robot)

    @impl GenServer
    def init(robot) do
      case Process.whereis(BB.Process.registry_name(robot)) do
        nil -> {:stop, :no_registry}
        registry -> {:ok, Process.link(registry)}
      end
    end
  end

  @doc "Starts the supervisors."
  @spec start_link(module()) :: Supervisor.on_start()
  def start_link(robot), do: Supervisor.start_link(__MODULE__, robot)

  @impl Supervisor
  def init(robot) do
    tasks = {Task.Supervisor, name: BB.Process.via(robot, BB.TaskSupervisor)}
    Supervisor.init([{RegistryLink, robot}, tasks], strategy: :one_for_all)
  end
end
