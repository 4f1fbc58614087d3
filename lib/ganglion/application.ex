defmodule Ganglion.Application do
  @moduledoc """
  The application `:ganglion`: its supervision tree, with safety beside it.

  OTP starts it. What it supervises depends on the configuration:

      outside of any application:
      BB.Safety.Supervisor                  see there
      ├── BB.Safety.Wardens                 a warden for each robot
      └── BB.Safety.HostWatch               watches this application

      Ganglion.Supervisor                   one_for_one
      ├── ▌ BB.Safety.Anchor                starts BB.Safety.Supervisor again
      ├── ▌ BB.Command.Results              the results of commands
      ├── ▌ BB.Bus.Sim.Registry             names of simulated buses
      ├── ▌ BB.Bus.Sim.GPIO.Registry        names of simulated chips of lines
      ├── ▌ BB.Bus.I2C.Supervisor           see there
      ├── ▌ BB.Bus.Sim                      if simulated_buses: is configured
      ├── ▌ BB.Firmware.Supervisor          if robot: is configured
      │     ├── BB.Firmware.Provisioning    once
      │     ├── ▌ BB.Firmware.Guard
      │     ├── ▌ BB.Firmware.Gate
      │     └── ▌ BB.Firmware.Network
      └── ▌ the robot                       if robot: is configured; see BB.Supervisor

  ▌ is a bulkhead (`BB.Process.Bulkhead`): it restarts its child without limit, so that a failure
  behind it never reaches another child. The application therefore ends only when it is stopped,
  or when Ganglion.Supervisor or the process above it is killed. Every armed robot is disarmed
  then, also the robots of other applications (`BB.Safety.HostWatch`). These continue to run
  disarmed, and can be armed as soon as the application has been started again.

  Guard, gate and network start before the robot and end after it.
  """

  use Application

  alias BB.Process.Bulkhead
  alias BB.Safety

  # All children are bulkheads: they end only when they are killed.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  @impl Application
  def start(_type, _args) do
    Safety.HostWatch.enter()
    BB.Callback.Failures.create()

    (always() ++ simulation(configured(:simulated_buses)) ++ robot(configured(:robot)))
    |> Enum.map(&Bulkhead.child_spec/1)
    |> Supervisor.start_link([strategy: :one_for_one, name: Ganglion.Supervisor] ++ @restarts)
  end

  @impl Application
  def prep_stop(state) do
    Safety.HostWatch.leave()
    state
  end

  defp always do
    [
      Safety.Anchor,
      BB.Command.Results,
      {Registry, keys: :unique, name: BB.Bus.Sim.Registry},
      {Registry, keys: :unique, name: BB.Bus.Sim.GPIO.Registry},
      BB.Bus.I2C.Supervisor
    ]
  end

  defp simulation(nil), do: []
  defp simulation(buses), do: [{BB.Bus.Sim, buses: buses}]

  defp robot(nil), do: []
  defp robot(robot), do: [{BB.Firmware.Supervisor, robot: robot}, robot]

  defp configured(key), do: Application.get_env(:ganglion, key)
end
