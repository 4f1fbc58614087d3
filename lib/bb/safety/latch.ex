defmodule BB.Safety.Latch do
  @moduledoc """
  Delays the end of a robot that is stopped until the robot is disarmed.

  It is a child of the robot's root supervisor before the topology, and so is stopped after it.
  When `Supervisor.stop/1` returns, or the machine goes down, no component runs and every
  `disarm/1` has returned.
  """
  @moduledoc no_example: "internal: BB.Supervisor starts it"

  use GenServer, shutdown: :infinity
  use BB.Process.Tolerant

  alias BB.Safety.Wardens

  @doc "Starts the latch of a robot."
  @spec start_link(module()) :: GenServer.on_start()
  def start_link(robot), do: GenServer.start_link(__MODULE__, robot)

  @impl GenServer
  def init(robot) do
    Process.flag(:trap_exit, true)
    {:ok, robot}
  end

  @impl GenServer
  def terminate(:shutdown, robot), do: Wardens.secure(robot)
  def terminate(_reason, _robot), do: :ok
end
