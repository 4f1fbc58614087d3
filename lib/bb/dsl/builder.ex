defmodule BB.Dsl.Builder do
  @moduledoc """
  Builds the tree of `BB.Dsl.Node` when a robot's module compiles.

  The words of the DSL call it from the module's body: `open/5` begins an entity, `set/4` sets a
  field of the innermost entity, `close/1` ends it. A module attribute has the stack of open
  entities. A declaration that breaks one of the `BB.Dsl.Rules` raises `BB.Dsl.Error`.
  """
  @moduledoc no_example: "internal: the words of BB.Dsl call it"

  alias BB.Dsl.{Error, Grammar, Node, References, Rules}

  @state :bb_dsl

  defstruct [:module, stack: [], unnamed: %{}, seen: %{}]

  @doc "Begins the declaration of a robot."
  @spec start(module(), Node.place()) :: :ok
  def start(module, place) do
    root = %Node{kind: :robot, path: [], place: place}
    save(%__MODULE__{module: module, stack: [root]})
  end

  @doc "Checks the declaration as a whole and returns its tree."
  @spec finish(module()) :: Node.t()
  def finish(module) do
    %__MODULE__{stack: [root]} = state = load(module)
    root = order_nodes(root)
    check_references(state, root, root, References.definitions(root))
    check_topics(state, root, (Node.fields_of(root, :settings) || %{})[:topic_prefix])
    Module.delete_attribute(module, @state)
    root
  end

  @doc """
  Begins an entity with its plain arguments (a name, a child) and the fields of its keywords.
  """
  @spec open(module(), atom(), [term()], keyword(), Node.place()) :: :ok
  def open(module, kind, arguments, fields, place) do
    state = load(module)
    {name, arguments} = take_name(state, kind, arguments, place)
    parent = hd(state.stack)
    check!(state, parent, place, Rules.check_place(kind, name, parent))

    node = %Node{
      kind: kind,
      name: name,
      child: List.first(arguments),
      path: parent.path ++ [name || kind],
      place: place
    }

    save(%{put_name(state, node) | stack: [node | state.stack]})
    set_all(module, fields, place)
  end

  @doc "Sets a field of the innermost entity."
  @spec set(module(), atom(), term(), Node.place()) :: :ok
  def set(module, field, value, place) do
    %{stack: [node | rest]} = state = load(module)
    value = check!(state, node, place, Rules.check_field(node, field, value))
    save(%{state | stack: [%{node | fields: Map.put(node.fields, field, value)} | rest]})
  end

  @doc "Ends the innermost entity."
  @spec close(module()) :: :ok
  def close(module) do
    %{stack: [node, parent | rest]} = state = load(module)
    check!(state, node, node.place, Rules.check_complete(node))
    save(%{state | stack: [%{parent | nodes: [order_nodes(node) | parent.nodes]} | rest]})
  end

  # A reference may stand above the declaration of its parameter.
  defp check_references(state, node, parent, definitions) do
    check!(state, node, node.place, References.check(node, parent, definitions))
    Enum.each(node.nodes, &check_references(state, &1, node, definitions))
  end

  # The settings may stand below the components.
  defp check_topics(state, node, prefix) do
    check!(state, node, node.place, Rules.check_topics(node, prefix))
    Enum.each(node.nodes, &check_topics(state, &1, prefix))
  end

  defp set_all(module, fields, place) do
    unless Keyword.keyword?(fields) do
      state = load(module)
      raise_error!(state, hd(state.stack), place, "expected keywords, got: #{inspect(fields)}")
    end

    Enum.each(fields, fn {field, value} -> set_or_open(module, field, value, place) end)
  end

  # `limit: [lower: …]` among a joint's keywords is the entity `limit lower: …`.
  defp set_or_open(module, field, value, place) do
    %{stack: [%{kind: kind} | _]} = load(module)

    if field in Grammar.entities(kind) and not Grammar.named?(field) do
      open(module, field, [], value, place)
      close(module)
    else
      set(module, field, value, place)
    end
  end

  defp take_name(state, kind, arguments, place) do
    cond do
      not Grammar.named?(kind) ->
        {nil, arguments}

      arguments == [] and Grammar.nameless?(kind) ->
        {unnamed(state, kind), []}

      true ->
        parent = hd(state.stack)
        name = List.first(arguments)
        check!(state, parent, place, Rules.check_name(kind, name, parent.kind))
        {name, Enum.drop(arguments, 1)}
    end
  end

  defp unnamed(state, kind), do: :"#{kind}_#{Map.get(state.unnamed, kind, 0)}"

  defp put_name(state, %{name: nil}), do: state

  defp put_name(state, %{kind: kind, name: name} = node) do
    key = namespace(kind, node.path)
    check!(state, node, node.place, Rules.check_unique(node, state.seen[key]))

    state = %{state | seen: Map.put(state.seen, key, node)}

    if name == unnamed(state, kind),
      do: %{state | unnamed: Map.update(state.unnamed, kind, 1, &(&1 + 1))},
      else: state
  end

  # The groups of a parameter are part of its name; all other names hold for the whole robot.
  defp namespace(kind, path) when kind in [:param, :group], do: {:param, path}
  defp namespace(kind, path) when kind in [:link, :joint], do: {kind, List.last(path)}
  defp namespace(kind, path) when kind in [:i2c, :gpio, :device], do: {kind, path}
  defp namespace(_kind, path), do: {:component, List.last(path)}

  defp check!(_state, _node, _place, :ok), do: :ok
  defp check!(_state, _node, _place, {:ok, value}), do: value
  defp check!(state, node, place, {:error, reason}), do: raise_error!(state, node, place, reason)

  defp raise_error!(state, node, place, reason) do
    raise Error,
      module: state.module,
      path: node.path,
      file: place.file,
      line: place.line,
      reason: reason
  end

  defp load(module), do: Module.get_attribute(module, @state)
  defp save(state), do: Module.put_attribute(state.module, @state, state)
  defp order_nodes(node), do: %{node | nodes: Enum.reverse(node.nodes)}
end
