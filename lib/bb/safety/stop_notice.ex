defmodule BB.Safety.StopNotice do
  @moduledoc """
  Announces that a robot is being stopped, so that the end of its topology supervisor is not taken
  for a failure.

  It is the last child of the robot's root supervisor, and so is stopped first. A topology
  supervisor that ends without this notice has died, and the robot is in the state `:error` then.
  """
  @moduledoc no_example: "internal: BB.Supervisor starts it"

  use GenServer
  use BB.Process.Tolerant

  alias BB.Safety.Wardens

  @doc "Starts the notice of a robot with a root supervisor."
  @spec start_link({module(), root :: pid()}) :: GenServer.on_start()
  def start_link({robot, root}), do: GenServer.start_link(__MODULE__, {robot, root})

  @impl GenServer
  def init({robot, root}) do
    Process.flag(:trap_exit, true)
    {:ok, {robot, root}}
  end

  @impl GenServer
  def terminate(:shutdown, {robot, root}), do: Wardens.announce_stop(robot, root)
  def terminate(_reason, _state), do: :ok
end
