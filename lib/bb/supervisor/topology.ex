defmodule BB.Supervisor.Topology do
  @moduledoc """
  The supervisor of a robot's topology, of a link or of a joint. `BB.Supervisor` starts the one of
  the topology, which starts the others.

  The topology has the components of the robot itself and the supervisor of the root link. A link
  has its components and the supervisors of its joints. A joint has its components and the
  supervisor of its child link.

  The child for a component is its keeper, which starts the component again without this
  supervisor. Only the death of a keeper itself counts here, and a keeper runs no code of others.
  """
  @moduledoc no_example: "internal: BB.Supervisor draws the tree"

  use Supervisor

  alias BB.Component.Keeper
  alias BB.Robot

  @max_restarts 100

  @typedoc "A part of the robot; `nil` for the topology as a whole."
  @type part :: nil | {:link, atom()} | {:joint, atom()}

  @doc """
  Returns the child specification of a part, for the supervisor of the part that carries it.
  """
  @spec child_spec({module(), part()}) :: Supervisor.child_spec()
  def child_spec({robot, part}) do
    %{
      id: part || :topology,
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
    if part == nil, do: BB.Safety.Wardens.watch(robot, :topology)
    declared = robot.robot()

    components =
      for component <- Robot.components_on(declared, part), do: {Keeper, {robot, component}}

    parts = for carried <- carried_parts(declared, part), do: {__MODULE__, {robot, carried}}
    Supervisor.init(components ++ parts, strategy: :one_for_one, max_restarts: @max_restarts)
  end

  defp carried_parts(%Robot{root_link: nil}, nil), do: []
  defp carried_parts(%Robot{root_link: root}, nil), do: [link: root]

  defp carried_parts(declared, {:link, name}) do
    {:ok, link} = Robot.fetch_link(declared, name)
    Enum.map(link.child_joints, &{:joint, &1})
  end

  defp carried_parts(declared, {:joint, name}) do
    {:ok, joint} = Robot.fetch_joint(declared, name)
    [link: joint.child_link]
  end
end
