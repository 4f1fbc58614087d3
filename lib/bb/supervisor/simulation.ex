defmodule BB.Supervisor.Simulation do
  @moduledoc """
  The simulated buses of a robot that declares what hangs on them (`simulation do … end`), where
  the robot's buses are simulated.

  Each bus stands behind a bulkhead, and so do all of them: whatever becomes of them spends no
  restarts of the robot's.
  """

  use Supervisor

  alias BB.Bus
  alias BB.Process.Bulkhead

  # Its children are bulkheads, which end only when they are killed.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  @doc "The child of a robot's root: none where nothing of it is simulated."
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

  # Chips of lines before buses, whose devices may drive a line.
  defp buses(%{gpio: chips, i2c: buses}) do
    for({name, opts} <- chips, Bus.GPIO.module(nil) == Bus.Sim.GPIO, do: {:gpio, name, opts}) ++
      for {name, opts} <- buses, Bus.I2C.backend() == Bus.Sim.I2C, do: {:i2c, name, opts}
  end
end
