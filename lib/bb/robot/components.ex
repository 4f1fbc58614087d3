defmodule BB.Robot.Components do
  @moduledoc """
  Makes the components of a robot, as `BB.Component`, from its declaration. Pure.
  `BB.Robot.Builder` uses it.
  """
  @moduledoc no_example: "internal: R.robot().components has its result"

  alias BB.{Component, Transmission, Unit}
  alias BB.Dsl.Child

  @doc """
  Returns the components in the order in which they start: the sensors and the controllers of the
  robot, then the topology, each link before its joints, each sensor before its estimators.
  """
  @spec of([BB.Dsl.Sensor.t()], [BB.Dsl.Controller.t()], [BB.Dsl.Link.t()]) :: [Component.t()]
  def of(sensors, controllers, roots) do
    Enum.flat_map(sensors, &of_sensor(&1, [], nil)) ++
      Enum.map(controllers, &component(&1, [], nil)) ++
      Enum.flat_map(roots, &of_link(&1, []))
  end

  defp of_link(link, above) do
    path = above ++ [link.name]
    place = {:link, link.name}

    Enum.flat_map(link.sensors, &of_sensor(&1, path, place)) ++
      Enum.map(link.estimators, &estimator(&1, path, place, [:estimator | path])) ++
      Enum.flat_map(link.joints, &of_joint(&1, path))
  end

  defp of_joint(joint, above) do
    path = above ++ [joint.name]

    place = {:joint, joint.name}

    Enum.flat_map(joint.sensors, &of_sensor(&1, path, place)) ++
      Enum.map(joint.actuators, &component(&1, path, place)) ++
      of_link(joint.link, path)
  end

  defp of_sensor(sensor, above, place) do
    path = above ++ [sensor.name]
    input = %BB.Dsl.Estimator.Input{name: sensor.name, path: [:sensor | path], driver?: true}

    estimators =
      for estimator <- sensor.estimators,
          do: estimator(%{estimator | inputs: [input]}, path, place, [:sensor | path])

    [component(sensor, above, place) | estimators]
  end

  # Its topic is below `above`, the topic of its sensor or its link.
  defp estimator(declared, path, place, above) do
    topic = above ++ [declared.name]
    {:ok, module, options} = Child.parse(declared.child_spec)

    %Component{
      name: declared.name,
      kind: BB.Estimator,
      module: module,
      options: options,
      path: path ++ [declared.name],
      attached_to: place,
      estimator: %{
        topic: topic,
        target_frame: List.last(path),
        inputs: Enum.map(declared.inputs, &Map.take(&1, [:name, :path, :driver?])),
        outputs:
          for(it <- declared.outputs, into: %{out: topic}, do: {it.name, it.path || topic}),
        sync_tolerance_ns: nanoseconds(declared.sync_tolerance),
        latency_budget_ns: nanoseconds(declared.latency_budget),
        lost_after_ns: nanoseconds(declared.lost_after),
        recover_after: declared.recover_after,
        on_degraded: declared.on_degraded,
        on_lost: declared.on_lost,
        on_recovered: declared.on_recovered
      }
    }
  end

  defp component(%type{} = declared, path, place) do
    {:ok, module, options} = Child.parse(declared.child_spec)

    %Component{
      name: declared.name,
      kind: kind(type),
      module: module,
      options: options,
      path: path ++ [declared.name],
      attached_to: place,
      transmission: transmission(Map.get(declared, :transmission), place),
      required: declared.required,
      retain: Map.get(declared, :retain, false),
      simulation: Map.get(declared, :simulation, :start),
      max_silence_ns: nanoseconds(Map.get(declared, :max_silence))
    }
  end

  defp kind(BB.Dsl.Sensor), do: BB.Sensor
  defp kind(BB.Dsl.Actuator), do: BB.Actuator
  defp kind(BB.Dsl.Controller), do: BB.Controller

  # Without a joint there is nothing to which a transmission could lead.
  defp transmission(%BB.Dsl.Transmission{} = declared, {:joint, _name}) do
    declared
    |> Map.from_struct()
    |> Enum.reject(fn {_key, value} -> value == nil end)
    |> Transmission.new()
  end

  defp transmission(_declared, _place), do: nil

  defp nanoseconds(nil), do: nil
  defp nanoseconds(%Unit{} = time), do: round(Unit.convert!(time, :nanosecond).value)
end
