defmodule Ganglion.Application do
  @moduledoc false
  use Application

  alias BB.Firmware.{Gate, Guard, Network, Provisioning}

  @impl Application
  def start(_type, _args) do
    # Here, so that the tables belong to the application's own process.
    BB.Safety.Table.create()

    children =
      [
        BB.Safety.Supervisor,
        {Registry, keys: :unique, name: BB.Bus.Sim.Registry},
        {Registry, keys: :unique, name: BB.Bus.Sim.GPIO.Registry},
        BB.Bus.I2C.Supervisor
      ] ++
        simulation(Application.get_env(:ganglion, :simulated_buses)) ++
        robot(Application.get_env(:ganglion, :robot))

    Supervisor.start_link(children, strategy: :one_for_one, name: Ganglion.Supervisor)
  end

  @impl Application
  def prep_stop(state) do
    BB.Safety.Supervisor.secure()
    state
  end

  defp simulation(nil), do: []
  defp simulation(buses), do: [{BB.Bus.Sim, buses: buses}]

  # What watches over the robot starts before it.
  defp robot(nil), do: []

  defp robot(robot) do
    watchers =
      for module <- [Guard, Gate, Network], do: {module, [robot: robot] ++ options(module)}

    [Provisioning] ++ watchers ++ [robot]
  end

  defp options(module), do: Application.get_env(:ganglion, module, [])
end
