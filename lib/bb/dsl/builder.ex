defmodule BB.Dsl.Builder do
  @moduledoc """
  Builds the tree of `BB.Dsl.Node` when a robot's module compiles.

  The words of the DSL call it from the module's body: `open/5` begins an entity, `set/4` sets a
  field of the innermost entity, `close/1` ends it. A module attribute has the stack of open
  entities. A declaration that breaks one of the `BB.Dsl.Rules` raises `BB.Dsl.Error`.
  """
  @moduledoc no_example: "internal: the words of BB.Dsl call it"

  alias BB.Dsl.{Commands, Error, Estimators, Grammar, Node, References, Rules, Warnings}

  @state :bb_dsl

  defstruct [:module, stack: [], seen: %{}]

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
    check_whole(state, root)
    Warnings.print(module, root)
    Module.delete_attribute(module, @state)
    root
  end

  # A reference may stand above the declaration of its parameter, and the settings below the
  # components.
  defp check_whole(state, root) do
    definitions = References.definitions(root)
    prefix = Node.section_fields(root, :settings)[:topic_prefix]

    check_nodes(state, root, root, fn node, parent ->
      with :ok <- References.check(node, parent, definitions),
           :ok <- Rules.check_topics(node, prefix),
           :ok <- Commands.check(node, root),
           do: Estimators.check(node, root)
    end)
  end

  defp check_nodes(state, node, parent, check) do
    check!(state, node, node.place, check.(node, parent))
    Enum.each(node.nodes, &check_nodes(state, &1, node, check))
  end

  @doc """
  Begins an entity with its plain arguments (a name, a child) and the fields of its keywords.
  """
  @spec open(module(), atom(), [term()], keyword(), Node.place()) :: :ok
  def open(module, kind, arguments, fields, place) do
    state = load(module)
    parent = hd(state.stack)
    check!(state, parent, place, check_keywords(fields))
    {name, arguments, fields} = take_name(state, kind, arguments, fields, place)
    check!(state, parent, place, Rules.check_place(kind, name, parent, roots(state)))

    node = %Node{
      kind: kind,
      name: name,
      path: parent.path ++ [name || kind],
      parent: parent.kind,
      place: place
    }

    {node, more} = put_arguments(node, arguments)
    save(%{put_name(state, node) | stack: [node | state.stack]})
    Enum.each(more ++ fields, fn {field, value} -> set_or_open(module, field, value, place) end)
  end

  @doc "Sets a field of the innermost entity."
  @spec set(module(), atom(), term(), Node.place()) :: :ok
  def set(module, field, value, place) do
    %{stack: [node | rest]} = state = load(module)

    if field == :name and Grammar.nameless?(node.kind) do
      rename(state, node, value, place)
    else
      taken = Map.merge(earlier_fields(state, node), node.fields)
      value = check!(state, node, place, Rules.check_field(node, field, value, taken))
      save(%{state | stack: [%{node | fields: Map.put(node.fields, field, value)} | rest]})
    end
  end

  @doc "Ends the innermost entity."
  @spec close(module()) :: :ok
  def close(module) do
    %{stack: [node, parent | rest]} = state = load(module)
    check!(state, node, node.place, Rules.check_complete(node))
    save(%{state | stack: [%{parent | nodes: [order_nodes(node) | parent.nodes]} | rest]})
  end

  @doc "Refuses a word that cannot stand in the innermost entity."
  @spec refuse(module(), atom(), Node.place()) :: no_return()
  def refuse(module, word, place) do
    %{stack: [node | _]} = state = load(module)
    raise_error!(state, node, place, Rules.unknown(word, node.kind))
  end

  defp check_keywords(fields) do
    if Keyword.keyword?(fields),
      do: :ok,
      else: {:error, "expected keywords, got: #{inspect(fields)}"}
  end

  # `limit: [lower: …]` among a joint's keywords is the entity `limit lower: …`.
  defp set_or_open(module, field, value, place) do
    %{stack: [%{kind: kind} | _]} = load(module)

    if field in Grammar.entities(kind) and 0 in Grammar.arities(field) do
      open(module, field, [], value, place)
      close(module)
    else
      set(module, field, value, place)
    end
  end

  # The arguments behind the name: a component's child, or a field.
  defp put_arguments(node, arguments) do
    node.kind
    |> Grammar.arguments()
    |> Keyword.delete(:name)
    |> Keyword.keys()
    |> Enum.zip(arguments)
    |> Enum.reduce({node, []}, fn
      {:child, child}, {node, more} -> {%{node | child: child}, more}
      field, {node, more} -> {node, more ++ [field]}
    end)
  end

  defp take_name(state, kind, arguments, fields, place) do
    cond do
      not Grammar.named?(kind) ->
        {nil, arguments, fields}

      arguments in [[], [nil]] and Grammar.nameless?(kind) ->
        {name, fields} = Keyword.pop(fields, :name)
        {given_name(state, kind, name, place), [], fields}

      match?([nil | _], arguments) and kind in Grammar.components() ->
        {unnamed(state, kind), tl(arguments), fields}

      true ->
        {given_name(state, kind, List.first(arguments), place), Enum.drop(arguments, 1), fields}
    end
  end

  defp given_name(state, kind, name, place) do
    if name == nil and Grammar.nameless?(kind) do
      unnamed(state, kind)
    else
      parent = hd(state.stack)
      check!(state, parent, place, Rules.check_name(kind, name, parent.kind))
      name
    end
  end

  # :link_0, or the next name that is free.
  defp unnamed(state, kind) do
    0
    |> Stream.iterate(&(&1 + 1))
    |> Stream.map(&:"#{kind}_#{&1}")
    |> Enum.find(&(not Map.has_key?(state.seen, {:unique, &1})))
  end

  # `collision do name :body … end`: the automatic name is free again.
  defp rename(%{stack: [_ | rest]} = state, node, name, place) do
    check!(state, node, place, Rules.check_name(node.kind, name, node.parent))
    state = %{state | seen: Map.delete(state.seen, namespace(node))}
    node = %{node | name: name, path: List.delete_at(node.path, -1) ++ [name]}
    save(%{put_name(state, node) | stack: [node | rest]})
  end

  defp put_name(state, %{name: nil}), do: state

  defp put_name(state, node) do
    key = namespace(node)
    check!(state, node, node.place, Rules.check_unique(node, state.seen[key]))
    %{state | seen: Map.put(state.seen, key, node)}
  end

  # The groups of a parameter are part of its name.
  defp namespace(%{kind: kind, path: path}) when kind in [:param, :group], do: {:param, path}

  defp namespace(%{kind: kind} = node) do
    if Grammar.unique?(kind), do: {:unique, node.name}, else: {kind, node.path}
  end

  # Sections of one kind add up.
  defp earlier_fields(state, node) do
    if node.parent == :robot, do: Node.section_fields(root(state), node.kind), else: %{}
  end

  defp roots(state) do
    open = for %{kind: :topology} = node <- state.stack, link <- Node.nodes(node, :link), do: link
    Node.in_sections(root(state), :topology, :link) ++ open
  end

  defp root(state), do: List.last(state.stack)

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
