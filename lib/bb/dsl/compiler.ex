defmodule BB.Dsl.Compiler do
  @moduledoc """
  Turns a declaration (`BB.Dsl.Node`), which the builder has checked, into a `BB.Robot`.
  """

  alias BB.{Component, Robot}
  alias BB.Dsl.{Child, Node}

  @doc "The robot that `node` declares."
  @spec robot(module(), Node.t()) :: Robot.t()
  def robot(module, %Node{kind: :robot} = node) do
    %Robot{name: module, settings: Node.fields_of(node, :settings) || %{}}
    |> each(Node.nodes(node, :sensors), fn section, robot ->
      components(robot, section, [], nil)
    end)
    |> each(Node.nodes(node, :topology), &topology/2)
    |> Map.update!(:components, &Enum.reverse/1)
  end

  defp topology(section, robot) do
    each(robot, Node.nodes(section, :link), fn link, robot ->
      link(%{robot | root_link: link.name}, link, [], nil)
    end)
  end

  defp link(robot, node, above, parent_joint) do
    path = above ++ [node.name]

    link = %Robot.Link{
      name: node.name,
      parent_joint: parent_joint,
      child_joints: names(node, :joint),
      sensors: names(node, :sensor)
    }

    %{robot | links: Map.put(robot.links, node.name, link)}
    |> components(node, path, {:link, node.name})
    |> each(Node.nodes(node, :joint), fn joint, robot ->
      joint(robot, joint, path, node.name)
    end)
  end

  defp joint(robot, node, above, parent_link) do
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
      sensors: names(node, :sensor)
    }

    %{robot | joints: Map.put(robot.joints, node.name, joint)}
    |> components(node, path, {:joint, node.name})
    |> link(child, path, node.name)
  end

  defp components(robot, node, path, place),
    do: each(robot, Node.nodes(node, :sensor), &sensor(&2, &1, path, place))

  defp sensor(robot, %{name: name} = node, path, place) do
    attached = %{name: name, attached_to: place, transmission: nil}

    %{
      robot
      | sensors: Map.put(robot.sensors, name, attached),
        components: [component(node, path, place) | robot.components]
    }
  end

  defp component(node, path, place) do
    {:ok, module, options} = Child.parse(node.child)

    %Component{
      name: node.name,
      kind: BB.Sensor,
      module: module,
      options: options,
      path: path ++ [node.name],
      attached_to: place,
      required: Map.get(node.fields, :required, false),
      retain: Map.get(node.fields, :retain, false),
      max_silence_ns: nanoseconds(node.fields[:max_silence])
    }
  end

  defp nanoseconds(nil), do: nil
  defp nanoseconds(%BB.Unit{} = time), do: round(BB.Unit.convert!(time, :nanosecond).value)

  defp names(node, kind), do: for(child <- Node.nodes(node, kind), do: child.name)
  defp each(robot, nodes, change), do: Enum.reduce(nodes, robot, change)
end
