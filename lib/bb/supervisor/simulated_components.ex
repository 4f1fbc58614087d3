defmodule BB.Supervisor.SimulatedComponents do
  @moduledoc """
  Returns the components of a robot that is started with `simulation:`. Pure. `BB.Supervisor` uses
  it.

    * Each actuator is a `BB.Sim.Actuator`. A sensor `:"<actuator>_position_estimator"` reports
      the position of its joint, unless the joint has a
      `BB.Sensor.OpenLoopPositionEstimator` for it.
    * A controller is omitted, a `BB.Sim.Controller` or itself, by its field `simulation`.
    * Sensors are themselves, usually on simulated buses.
  """
  @moduledoc no_example: "internal: BB.Supervisor.start_link/2 has the option"

  alias BB.Component

  # It publishes by BB, which builds on the supervisors.
  @estimator Module.concat(["BB", "Sensor", "OpenLoopPositionEstimator"])

  @doc "Returns the components of a robot that is simulated, in the order in which they start."
  @spec of([Component.t()]) :: [Component.t()]
  def of(components), do: Enum.flat_map(components, &simulated(&1, components))

  defp simulated(%{kind: BB.Actuator} = actuator, components) do
    estimator = if estimated?(actuator, components), do: [], else: [estimator(actuator)]
    [%{actuator | module: BB.Sim.Actuator, options: []} | estimator]
  end

  defp simulated(%{kind: BB.Controller, simulation: :omit}, _components), do: []

  defp simulated(%{kind: BB.Controller, simulation: :mock} = controller, _components),
    do: [%{controller | module: BB.Sim.Controller, options: []}]

  defp simulated(component, _components), do: [component]

  defp estimated?(%{name: name, attached_to: joint}, components) do
    Enum.any?(components, fn component ->
      component.module == @estimator and component.attached_to == joint and
        component.options[:actuator] == name
    end)
  end

  # The number of actuators bounds the number of these names.
  defp estimator(actuator) do
    name = :"#{actuator.name}_position_estimator"

    %Component{
      name: name,
      kind: BB.Sensor,
      module: @estimator,
      options: [actuator: actuator.name],
      path: List.replace_at(actuator.path, -1, name),
      attached_to: actuator.attached_to
    }
  end
end
