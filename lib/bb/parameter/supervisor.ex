defmodule BB.Parameter.Supervisor do
  @moduledoc """
  The robot's runtime in its tree: the table of its parameters, what has a store keep them, and
  their owner. The last two are started again without losing a value.
  """

  use Supervisor

  alias BB.Parameter.{Owner, Persistence, Startup, Values}

  @max_restarts 100

  @doc """
  The runtime's place under the robot's root. `given` are the values of `start_link(params: …)`.
  """
  @spec child_spec({module(), Startup.values()}) :: Supervisor.child_spec()
  def child_spec({robot, given}) do
    %{id: :runtime, start: {__MODULE__, :start_link, [{robot, given}]}, type: :supervisor}
  end

  @doc "Starts the runtime."
  @spec start_link({module(), Startup.values()}) :: Supervisor.on_start()
  def start_link({robot, given}), do: Supervisor.start_link(__MODULE__, {robot, given})

  @impl Supervisor
  def init({robot, given}) do
    children = [{Values, robot}, {Persistence, robot}, {Owner, {robot, given}}]
    Supervisor.init(children, strategy: :rest_for_one, max_restarts: @max_restarts)
  end
end
