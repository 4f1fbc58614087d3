defmodule BB.Supervisor.Topology do
  @moduledoc """
  The supervisor of one part of a robot: of the robot's topology as a whole, of a link or of a joint.

  The topology holds the components of the robot itself and the supervisor of the root link; a link its components and the
  supervisors of its joints; a joint its components and the supervisor of its child link. Each component stands there as its
  keeper, which starts it again without this supervisor; only the death of a keeper itself, which has no code but ours in
  it, counts here.
  """

  use Supervisor

  alias BB.Component.Keeper
  alias BB.Robot

  @max_restarts 100

  @typedoc "`nil` is the topology as a whole."
  @type part :: nil | {:link, atom()} | {:joint, atom()}

  @doc "The place of a part under the supervisor of the part that carries it."
  @spec child_spec({module(), part()}) :: Supervisor.child_spec()
  def child_spec({robot, part}) do
    %{
      id: part || :topology,
      start: {__MODULE__, :start_link, [{robot, part}]},
      type: :supervisor,
      shutdown: :infinity
    }
  end

  @doc "Starts a part with all it carries."
  @spec start_link({module(), part()}) :: Supervisor.on_start()
  def start_link({robot, part}),
    do: BB.Process.supervisor_module(robot).start_link(__MODULE__, {robot, part}, [])

  @impl Supervisor
  def init({robot, part}) do
    if part == nil, do: BB.Safety.Warden.watch(robot, :topology)
    declared = robot.robot()

    components =
      for component <- Robot.components_on(declared, part), do: {Keeper, {robot, component}}

    parts = for carried <- carried(declared, part), do: {__MODULE__, {robot, carried}}
    Supervisor.init(components ++ parts, strategy: :one_for_one, max_restarts: @max_restarts)
  end

  defp carried(%Robot{root_link: nil}, nil), do: []
  defp carried(%Robot{root_link: root}, nil), do: [link: root]

  defp carried(declared, {:link, name}) do
    {:ok, link} = Robot.fetch_link(declared, name)
    Enum.map(link.child_joints, &{:joint, &1})
  end

  defp carried(declared, {:joint, name}) do
    {:ok, joint} = Robot.fetch_joint(declared, name)
    [link: joint.child_link]
  end
end
