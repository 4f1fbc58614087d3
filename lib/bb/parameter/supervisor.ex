defmodule BB.Parameter.Supervisor do
  @moduledoc """
  Supervises the processes of a robot's parameters: the table of the values, the process that
  saves them, and the process that sets them. The last two can be started again without the loss
  of a value. `BB.Supervisor` starts it.
  """
  @moduledoc no_example: "internal: BB.Parameter is its interface"

  use Supervisor

  alias BB.Parameter.{Owner, Persistence, Startup, Values}

  @max_restarts 100

  @typedoc """
  The robot, the values of `start_link(params: …)`, and what starts after the parameters and ends
  with them.
  """
  @type argument :: {module(), Startup.values(), [Supervisor.child_spec() | {module(), term()}]}

  @doc "Returns the child specification for the robot's root supervisor."
  @spec child_spec(argument()) :: Supervisor.child_spec()
  def child_spec(argument) do
    %{id: :runtime, start: {__MODULE__, :start_link, [argument]}, type: :supervisor}
  end

  @doc "Starts the supervisor."
  @spec start_link(argument()) :: Supervisor.on_start()
  def start_link(argument), do: Supervisor.start_link(__MODULE__, argument)

  @impl Supervisor
  def init({robot, given, more}) do
    children = [{Values, robot}, {Persistence, robot}, {Owner, {robot, given}}]
    Supervisor.init(children ++ more, strategy: :rest_for_one, max_restarts: @max_restarts)
  end
end
