defmodule BB.Supervisor.Topology do
  @moduledoc """
  The supervisor of a robot's topology, of a link or of a joint. `BB.Supervisor` starts the one of
  the topology, which starts the others.

  The topology has the supervisors of the robot's own sensors, of its controllers and of the root
  link, which start in this order. A link has its components and the supervisors of its joints. A
  joint has its components and the supervisor of its child link. So a controller has its name when
  an actuator starts, whose `init/1` may call it.

  The first three are registered in the robot's registry, as `BB.TopologySupervisor`,
  `BB.SensorSupervisor` and `BB.ControllerSupervisor`. When the registry itself is restarted, they
  run on without these names.

  The child for a component is its keeper, which starts the component again without this
  supervisor. Only the death of a keeper itself counts here, and a keeper runs no code of others.
  """
  @moduledoc no_example: "internal: BB.Supervisor draws the tree"

  use Supervisor

  alias BB.Component.Keeper
  alias BB.Robot
  alias BB.Robot.SimulationMode
  alias BB.Supervisor.Name

  @max_restarts 100

  # The names of the parts that have one.
  @names %{
    nil: BB.TopologySupervisor,
    sensors: BB.SensorSupervisor,
    controllers: BB.ControllerSupervisor
  }

  @typedoc "A part of the robot; `nil` for the topology as a whole."
  @type part :: nil | :sensors | :controllers | {:link, atom()} | {:joint, atom()}

  @doc """
  Returns the child specification of a part, for the supervisor of the part that carries it.
  """
  @spec child_spec({module(), part()}) :: Supervisor.child_spec()
  def child_spec({robot, part}) do
    %{
      id: @names[part] || part,
      start: {__MODULE__, :start_link, [{robot, part}]},
      type: :supervisor,
      shutdown: :infinity
    }
  end

  @doc "Starts the supervisor of a part, with everything that the part carries."
  @spec start_link({module(), part()}) :: Supervisor.on_start()
  def start_link({robot, part}),
    do: BB.Process.supervisor_module(robot).start_link(__MODULE__, {robot, part}, [])

  @impl Supervisor
  def init({robot, part}) do
    if name = @names[part], do: Name.register(robot, name)
    if part == nil, do: BB.Safety.Wardens.watch(robot, :topology)
    declared = %{robot.robot() | components: SimulationMode.components(robot)}
    components = for component <- components(declared, part), do: {Keeper, {robot, component}}
    parts = for carried <- carried_parts(declared, part), do: {__MODULE__, {robot, carried}}
    Supervisor.init(components ++ parts, strategy: :one_for_one, max_restarts: @max_restarts)
  end

  defp components(_declared, nil), do: []
  defp components(declared, :sensors), do: declared |> of_robot() |> Enum.reject(&controller?/1)

  defp components(declared, :controllers),
    do: declared |> of_robot() |> Enum.filter(&controller?/1)

  defp components(declared, part), do: Robot.components_on(declared, part)

  defp of_robot(declared), do: Robot.components_on(declared, nil)
  defp controller?(component), do: component.kind.component_kind() == :controller

  defp carried_parts(%Robot{root_link: nil}, nil), do: [:sensors, :controllers]
  defp carried_parts(%Robot{root_link: root}, nil), do: [:sensors, :controllers, {:link, root}]
  defp carried_parts(_declared, part) when part in [:sensors, :controllers], do: []

  defp carried_parts(declared, {:link, name}) do
    {:ok, link} = Robot.fetch_link(declared, name)
    Enum.map(link.child_joints, &{:joint, &1})
  end

  defp carried_parts(declared, {:joint, name}) do
    {:ok, joint} = Robot.fetch_joint(declared, name)
    [link: joint.child_link]
  end
end
