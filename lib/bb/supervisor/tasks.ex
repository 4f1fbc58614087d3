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

    @retry_ms 10

    @doc """
    Starts the process. It ends a moment later while the registry does not run, so that no start
    fails and spends restarts of the root, which starts the registry.
    """
    @spec start_link(module()) :: GenServer.on_start()
    def start_link(robot), do: GenServer.start_link(__MODULE__, robot)

    @impl GenServer
    def init(robot) do
      case Process.whereis(BB.Process.registry_name(robot)) do
        nil -> {:ok, Process.send_after(self(), :stop, @retry_ms)}
        registry -> {:ok, Process.link(registry)}
      end
    end

    @impl GenServer
    def handle_info(:stop, state), do: {:stop, {:shutdown, :no_registry}, state}
  end

  @doc "Starts the supervisors."
  @spec start_link(module()) :: Supervisor.on_start()
  def start_link(robot), do: Supervisor.start_link(__MODULE__, robot)

  @impl Supervisor
  def init(robot) do
    tasks = %{
      id: BB.TaskSupervisor,
      start: {__MODULE__, :start_tasks, [robot]},
      type: :supervisor
    }

    Supervisor.init([{RegistryLink, robot}, tasks], strategy: :one_for_all)
  end

  @doc false
  @spec start_tasks(module()) :: Supervisor.on_start() | :ignore
  def start_tasks(robot) do
    if Process.whereis(BB.Process.registry_name(robot)),
      do: Task.Supervisor.start_link(name: BB.Process.via(robot, BB.TaskSupervisor)),
      else: :ignore
  end
end
