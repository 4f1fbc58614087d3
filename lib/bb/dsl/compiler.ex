defmodule BB.Dsl.Compiler do
  @moduledoc """
  Turns the checked declaration of a robot (`BB.Dsl.Node`) into a `BB.Robot`. `BB.Dsl` calls it
  when a robot's module compiles.
  """
  @moduledoc no_example: "internal: R.robot() returns its result"

  alias BB.{Component, Robot, Transmission}
  alias BB.Dsl.{Child, Grammar, Node, References}
  alias BB.Parameter.Reference

  @behaviours %{sensor: BB.Sensor, actuator: BB.Actuator, controller: BB.Controller}
  @collections %{sensor: :sensors, actuator: :actuators, controller: :controllers}

  @doc "Returns the robot that `node` declares."
  @spec robot(module(), Node.t()) :: Robot.t()
  def robot(module, %Node{kind: :robot} = node) do
    %Robot{name: module, settings: Node.fields_of(node, :settings) || %{}}
    |> Map.put(:parameters, parameters(node))
    |> reduce(Node.nodes(node, :sensors), &add_components(&2, &1, [], nil))
    |> reduce(Node.nodes(node, :controllers), &add_components(&2, &1, [], nil))
    |> reduce(Node.nodes(node, :topology), &add_topology/2)
    |> Map.put(:simulation, simulation(node))
    |> Map.update!(:components, &Enum.reverse/1)
    |> put_subscriptions()
  end

  defp simulation(node) do
    sections = Node.nodes(node, :simulation)

    for kind <- [:i2c, :gpio], into: %{} do
      buses = for section <- sections, bus <- Node.nodes(section, kind), do: bus
      {kind, Enum.map(buses, &{&1.name, Map.to_list(&1.fields) ++ [devices: devices(&1)]})}
    end
  end

  defp devices(bus) do
    for device <- Node.nodes(bus, :device) do
      {:ok, module, options} = Child.parse(device.child)
      {device.name, {module, options}}
    end
  end

  # In the order of the declaration.
  defp parameters(node) do
    definitions = References.definitions(node)
    for path <- param_paths(Node.nodes(node, :parameters)), do: Map.fetch!(definitions, path)
  end

  defp param_paths(nodes) do
    Enum.flat_map(nodes, fn
      %Node{kind: :param, path: [:parameters | path]} -> [path]
      %Node{nodes: nodes} -> param_paths(nodes)
    end)
  end

  defp add_topology(section, robot) do
    reduce(robot, Node.nodes(section, :link), fn link, robot ->
      add_link(%{robot | root_link: link.name}, link, [], nil)
    end)
  end

  defp add_link(robot, node, above, parent_joint) do
    path = above ++ [node.name]

    link = %Robot.Link{
      name: node.name,
      parent_joint: parent_joint,
      child_joints: names(node, :joint),
      sensors: names(node, :sensor)
    }

    %{robot | links: Map.put(robot.links, node.name, link)}
    |> add_components(node, path, {:link, node.name})
    |> reduce(Node.nodes(node, :joint), fn joint, robot ->
      add_joint(robot, joint, path, node.name)
    end)
  end

  defp add_joint(robot, node, above, parent_link) do
    path = above ++ [node.name]
    [child] = Node.nodes(node, :link)

    joint = %Robot.Joint{
      name: node.name,
      type: node.fields.type,
      parent_link: parent_link,
      child_link: child.name,
      origin: Node.fields_of(node, :origin),
      axis: Node.fields_of(node, :axis),
      limit: Node.fields_of(node, :limit),
      dynamics: Node.fields_of(node, :dynamics),
      sensors: names(node, :sensor),
      actuators: names(node, :actuator)
    }

    %{robot | joints: Map.put(robot.joints, node.name, joint)}
    |> add_components(node, path, {:joint, node.name})
    |> add_link(child, path, node.name)
  end

  defp add_components(robot, node, path, place) do
    components = Enum.filter(node.nodes, &(&1.kind in Grammar.components()))
    reduce(robot, components, &add_component(&2, &1, path, place))
  end

  defp add_component(robot, %{name: name, kind: kind} = node, path, place) do
    component = component(node, path, place)
    attached = Map.take(component, [:name, :attached_to, :transmission])

    robot
    |> Map.update!(@collections[kind], &Map.put(&1, name, attached))
    |> Map.update!(:components, &[component | &1])
  end

  defp component(node, path, place) do
    {:ok, module, options} = Child.parse(node.child)

    %Component{
      name: node.name,
      kind: @behaviours[node.kind],
      module: module,
      options: options,
      path: path ++ [node.name],
      attached_to: place,
      transmission: transmission(Node.fields_of(node, :transmission)),
      required: Map.get(node.fields, :required, false),
      retain: Map.get(node.fields, :retain, false),
      max_silence_ns: nanoseconds(node.fields[:max_silence])
    }
  end

  defp transmission(nil), do: nil
  defp transmission(fields), do: Transmission.new(fields)

  defp nanoseconds(nil), do: nil
  defp nanoseconds(%BB.Unit{} = time), do: round(BB.Unit.convert!(time, :nanosecond).value)

  # Places that follow parameters

  defp put_subscriptions(robot) do
    places =
      Enum.flat_map(robot.components, &places_in_component/1) ++
        Enum.flat_map(robot.joints, &places_in_joint/1)

    followed = Enum.group_by(places, &elem(&1, 0), &elem(&1, 1))
    %{robot | param_subscriptions: followed}
  end

  defp places_in_component(component) do
    place = [:"#{component.kind.component_kind()}s", component.name]
    places(component.options, place) ++ places(component.transmission, place ++ [:transmission])
  end

  defp places_in_joint({name, joint}) do
    Enum.flat_map([:origin, :axis, :limit], fn field ->
      joint |> Map.fetch!(field) |> places([:joints, name, field])
    end)
  end

  defp places(nil, _place), do: []

  defp places(fields, place),
    do: for({key, %Reference{path: path}} <- fields, do: {path, place ++ [key]})

  defp names(node, kind), do: for(child <- Node.nodes(node, kind), do: child.name)
  defp reduce(robot, nodes, change), do: Enum.reduce(nodes, robot, change)
end
