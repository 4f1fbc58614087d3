defmodule BB.Supervisor.Simulation do
  @moduledoc """
  Supervises the simulated buses of a robot, which its section `simulation` declares.
  `BB.Supervisor` starts it where the robot's buses are simulated.

  Each bus has a bulkhead of its own, and this supervisor has one too, so that their failures
  spend no restarts of the robot's supervisors.
  """
  @moduledoc no_example: "internal: BB.Dsl.Robot.simulation/1 declares the buses"

  use Supervisor

  alias BB.Bus
  alias BB.Process.Bulkhead

  # The children are bulkheads, which end only when they are killed.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  @doc """
  Returns the child specifications for the robot's root supervisor: none where the robot has no
  simulated bus.
  """
  @spec children(module()) :: [Supervisor.child_spec()]
  def children(robot) do
    case buses(robot.robot().simulation) do
      [] -> []
      buses -> [Bulkhead.child_spec(spec(robot, buses))]
    end
  end

  defp spec(robot, buses) do
    start = {__MODULE__, :start_link, [{robot, buses}]}
    %{id: :simulation, start: start, type: :supervisor, shutdown: :infinity}
  end

  @doc false
  def start_link({robot, _buses} = argument),
    do: BB.Process.supervisor_module(robot).start_link(__MODULE__, argument, [])

  @impl Supervisor
  def init({robot, buses}) do
    buses
    |> Enum.map(fn {kind, name, opts} ->
      Bulkhead.child_spec({Bus.Sim.Wiring, {robot, kind, name, opts}})
    end)
    |> Supervisor.init([strategy: :one_for_one] ++ @restarts)
  end

  # Chips of lines come before buses, because a device on a bus may drive a line.
  defp buses(%{gpio: chips, i2c: buses}) do
    for({name, opts} <- chips, Bus.GPIO.module(nil) == Bus.Sim.GPIO, do: {:gpio, name, opts}) ++
      for {name, opts} <- buses, Bus.I2C.backend() == Bus.Sim.I2C, do: {:i2c, name, opts}
  end
end
