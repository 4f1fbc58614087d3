defmodule BB.Robot.Builder do
  @moduledoc """
  Builds the description of a robot in SI units, a `BB.Robot`, from its declaration.

  `use BB` calls it when the robot's module compiles. Use `build/1` to build the description
  again.

      BB.Robot.Builder.build(MyRobot) == MyRobot.robot()
      #=> true
  """

  alias BB.{Component, Robot}
  alias BB.Dsl.{Compiler, Info}
  alias BB.Robot.{Components, Joint, Link, Resolved, Shapes, Topology}

  # The parts of a link and of a joint that may follow parameters, with their field in BB.Robot.
  @link_parts [inertial: [], inertia: [:inertia], origin: [:center_of_mass]]
  @joint_parts [
    origin: [:origin],
    axis: [:axis],
    limit: [:limits],
    dynamics: [:dynamics]
  ]

  @doc "Returns the description of a robot's module."
  @spec build(module()) :: Robot.t()
  def build(robot), do: build(robot, Info.declaration(robot))

  @doc "Returns the description that a declaration makes of a robot."
  @spec build(module(), Compiler.declaration()) :: Robot.t()
  def build(module, declaration) do
    roots = for %BB.Dsl.Link{} = link <- declaration.topology, do: link
    components = Components.of(declaration.sensors, declaration.controllers, roots)
    links = Enum.flat_map(roots, &links(&1, nil))
    joints = Enum.flat_map(roots, &joints/1)

    %Robot{
      name: module,
      root_link: with([root | _] <- roots, do: root.name, else: ([] -> nil)),
      settings: declaration.settings,
      links: Map.new(links, fn {link, parent} -> {link.name, link(link, parent)} end),
      joints: Map.new(joints, fn {joint, parent} -> {joint.name, joint(joint, parent)} end),
      sensors: attached(components, BB.Sensor),
      actuators: attached(components, BB.Actuator),
      controllers: attached(components, BB.Controller),
      topology: Topology.new(Enum.map(roots, &tree/1)),
      parameters: declaration.definitions,
      components: components,
      simulation: declaration.simulation,
      param_subscriptions: subscriptions(links, joints, components),
      declared_axes:
        for(
          {%{axis: axis} = joint, _} <- joints,
          follows?(axis),
          into: %{},
          do: {joint.name, axis}
        )
    }
  end

  defp links(link, parent),
    do: [{link, parent} | Enum.flat_map(link.joints, &links(&1.link, &1.name))]

  defp joints(link) do
    Enum.flat_map(link.joints, fn joint -> [{joint, link.name} | joints(joint.link)] end)
  end

  defp tree(link), do: {link.name, for(joint <- link.joints, do: {joint.name, tree(joint.link)})}

  defp link(declared, parent_joint) do
    %Link{
      name: declared.name,
      parent_joint: parent_joint,
      child_joints: names(declared.joints),
      mass: declared.inertial && Resolved.to_si(declared.inertial.mass),
      center_of_mass: declared.inertial && center_of_mass(declared.inertial.origin),
      inertia: declared.inertial && numbers(declared.inertial.inertia),
      visual: Shapes.visual(declared.visual),
      collisions: Enum.map(declared.collisions, &Shapes.collision/1),
      sensors: names(declared.sensors)
    }
  end

  defp joint(declared, parent_link) do
    %Joint{
      name: declared.name,
      type: declared.type,
      parent_link: parent_link,
      child_link: declared.link.name,
      origin: origin(declared.origin),
      axis: declared.axis && Resolved.axis(declared.axis),
      limits: numbers(declared.limit),
      dynamics: numbers(declared.dynamics),
      sensors: names(declared.sensors),
      actuators: names(declared.actuators)
    }
  end

  defp origin(nil), do: nil

  defp origin(declared) do
    {position, orientation} = Shapes.origin(declared)
    %{position: position, orientation: orientation}
  end

  defp center_of_mass(nil), do: nil
  defp center_of_mass(declared), do: declared |> Shapes.origin() |> elem(0)

  defp numbers(nil), do: nil
  defp numbers(declared), do: Resolved.numbers(declared)

  # Components

  defp attached(components, kind) do
    for %Component{kind: ^kind} = component <- components, into: %{} do
      {component.name, Map.merge(entry(component), joint_of(component))}
    end
  end

  defp entry(component) do
    %{
      name: component.name,
      attached_to: component.attached_to || :robot,
      transmission: component.transmission && si_transmission(component.transmission)
    }
  end

  defp joint_of(%Component{kind: BB.Actuator, attached_to: {:joint, name}}), do: %{joint: name}
  defp joint_of(_component), do: %{}

  defp si_transmission(declared),
    do: Map.new(declared, fn {key, value} -> {key, Resolved.to_si(value)} end)

  # The places that follow parameters

  defp subscriptions(links, joints, components) do
    places =
      Enum.flat_map(links, &link_places/1) ++
        Enum.flat_map(joints, &joint_places/1) ++
        Enum.flat_map(components, &component_places/1)

    Enum.group_by(places, &elem(&1, 0), &elem(&1, 1))
  end

  defp link_places({%{inertial: nil}, _parent}), do: []

  defp link_places({link, _parent}) do
    parts = Map.put(Map.from_struct(link.inertial), :inertial, Map.take(link.inertial, [:mass]))

    for {part, keys} <- @link_parts, place <- places(parts[part], keys), inside_link?(place) do
      {path, keys} = place
      {path, {:link, link.name, keys}}
    end
  end

  # The orientation of the centre of mass is not in the description.
  defp inside_link?({_path, [:center_of_mass, field]}), do: field in [:x, :y, :z]
  defp inside_link?(_place), do: true

  defp joint_places({joint, _parent}) do
    for {part, keys} <- @joint_parts,
        {path, keys} <- places(Map.fetch!(joint, part), keys),
        do: {path, {:joint, joint.name, keys}}
  end

  defp component_places(component) do
    for {path, keys} <- places(component.transmission, [:transmission]),
        do: {path, {component.kind.component_kind(), component.name, keys}}
  end

  defp places(nil, _keys), do: []

  defp places(declared, keys) do
    for {field, %BB.Parameter.Reference{path: path}} <- fields(declared),
        do: {path, keys ++ [field]}
  end

  defp follows?(nil), do: false
  defp follows?(declared), do: places(declared, []) != []

  defp fields(%_{} = declared), do: declared |> Map.from_struct() |> Enum.sort()
  defp fields(declared), do: Enum.sort(declared)

  defp names(entities), do: Enum.map(entities, & &1.name)
end
