defmodule BB.Dsl.Compiler do
  @moduledoc """
  Turns the checked declaration of a robot (`BB.Dsl.Node`) into the structs that `BB.Dsl.Info`
  returns. `BB.Dsl` calls it when a robot's module compiles; `BB.Robot.Builder` makes the
  `BB.Robot` of the result.
  """
  @moduledoc no_example: "internal: BB.Dsl.Info returns its result"

  alias BB.Dsl.{Child, Commands, Grammar, Node, References}

  @typedoc "A declaration: the entities of each section, and what is not an entity."
  @type declaration :: %{
          settings: %{atom() => term()},
          topology: [struct()],
          sensors: [struct()],
          controllers: [struct()],
          parameters: [struct()],
          definitions: [BB.Parameter.Definition.t()],
          commands: [struct()],
          states: [struct()],
          initial_state: atom(),
          simulation: %{i2c: list(), gpio: list()}
        }

  @doc "Returns the declaration of a tree."
  @spec declaration(Node.t()) :: declaration()
  def declaration(%Node{kind: :robot} = root) do
    %{
      settings: Node.section_fields(root, :settings),
      topology: entities(root, :topology, [:link]) ++ entities(root, :topology, [:joint]),
      sensors: entities(root, :sensors, [:sensor]),
      controllers: entities(root, :controllers, [:controller]),
      parameters: entities(root, :parameters, [:param, :group, :bridge]),
      definitions: definitions(root),
      commands: entities(root, :commands, [:command, :category]),
      states: entities(root, :states, [:state]),
      initial_state: Map.get(Node.section_fields(root, :states), :initial_state, :idle),
      simulation: simulation(root)
    }
  end

  defp entities(root, section, kinds) do
    for node <- Node.nodes(root, section),
        inner <- node.nodes,
        inner.kind in kinds,
        do: entity(inner)
  end

  @doc "Returns the struct of an entity, with the structs of the entities inside it."
  @spec entity(Node.t()) :: struct()
  def entity(%Node{} = node) do
    node.kind
    |> Grammar.struct_of()
    |> struct!(Map.merge(own_fields(node), inner_fields(node)))
    |> complete()
  end

  defp own_fields(node) do
    node.fields
    |> Map.merge(if node.name, do: %{name: node.name}, else: %{})
    |> Map.merge(if node.child, do: %{child_spec: node.child}, else: %{})
  end

  defp inner_fields(node) do
    node.kind
    |> Grammar.holds()
    |> Enum.group_by(&elem(&1, 1), &elem(&1, 0))
    |> Enum.flat_map(fn {{number, key}, kinds} ->
      node.nodes |> Enum.filter(&(&1.kind in kinds)) |> Enum.map(&entity/1) |> field(number, key)
    end)
    |> Map.new()
  end

  defp field([], _number, _key), do: []
  defp field([entity], :one, key), do: [{key, entity}]
  defp field(entities, :many, key), do: [{key, entities}]

  defp complete(%BB.Dsl.Command{category: nil} = command),
    do: Commands.flagged(%{command | category: :default})

  defp complete(%BB.Dsl.Command{} = command), do: Commands.flagged(command)
  defp complete(entity), do: entity

  # In the order of the declaration.
  defp definitions(root) do
    definitions = References.definitions(root)

    for %Node{kind: :param, path: [:parameters | path]} <- Node.all(root),
        do: Map.fetch!(definitions, path)
  end

  defp simulation(root) do
    for kind <- [:i2c, :gpio], into: %{} do
      buses = Node.in_sections(root, :simulation, kind)
      {kind, Enum.map(buses, &{&1.name, Map.to_list(&1.fields) ++ [devices: devices(&1)]})}
    end
  end

  defp devices(bus) do
    for device <- Node.nodes(bus, :device) do
      {:ok, module, options} = Child.parse(device.child)
      {device.name, {module, options}}
    end
  end
end
