defmodule BB.Parameter.Supervisor do
  @moduledoc """
  The robot's runtime in its tree: the table of its parameters, and their owner, which is started again without
  losing them.
  """

  use Supervisor

  alias BB.Parameter.{Owner, Startup, Table}

  @max_restarts 100

  @doc "The runtime's place under the robot's root. `given` are the values of `start_link(params: …)`."
  @spec child_spec({module(), Startup.values()}) :: Supervisor.child_spec()
  def child_spec({robot, given}) do
    %{id: :runtime, start: {__MODULE__, :start_link, [{robot, given}]}, type: :supervisor}
  end

  @doc "Starts the runtime."
  @spec start_link({module(), Startup.values()}) :: Supervisor.on_start()
  def start_link({robot, given}), do: Supervisor.start_link(__MODULE__, {robot, given})

  @impl Supervisor
  def init({robot, given}) do
    children = [{Table, robot}, {Owner, {robot, given}}]
    Supervisor.init(children, strategy: :rest_for_one, max_restarts: @max_restarts)
  end
end
