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

  @doc """
  Returns the child specification for the robot's root supervisor. `given` are the values of
  `start_link(params: …)`.
  """
  @spec child_spec({module(), Startup.values()}) :: Supervisor.child_spec()
  def child_spec({robot, given}) do
    %{id: :runtime, start: {__MODULE__, :start_link, [{robot, given}]}, type: :supervisor}
  end

  @doc "Starts the supervisor."
  @spec start_link({module(), Startup.values()}) :: Supervisor.on_start()
  def start_link({robot, given}), do: Supervisor.start_link(__MODULE__, {robot, given})

  @impl Supervisor
  def init({robot, given}) do
    children = [{Values, robot}, {Persistence, robot}, {Owner, {robot, given}}]
    Supervisor.init(children, strategy: :rest_for_one, max_restarts: @max_restarts)
  end
end
