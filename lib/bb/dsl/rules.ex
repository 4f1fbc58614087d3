defmodule BB.Dsl.Rules do
  @moduledoc """
  What makes a declaration wrong, in words: each rule returns `:ok` or `{:error, reason}`. Pure.
  """

  alias BB.Dsl.{Child, Error, Grammar, Node}
  alias BB.Bus.Sim.GPIO.Part
  alias BB.Bus.Sim.Slot
  alias BB.{Options, Path, Topic, Unit}
  alias BB.Parameter.{Definition, Reference}

  @behaviours %{sensor: BB.Sensor, actuator: BB.Actuator, controller: BB.Controller}

  # Of a simulated chip without a word on them.
  @lines 54

  @type verdict :: :ok | {:error, String.t()}

  @doc "Whether `name` can name an entity of `kind` inside one of the kind `parent`."
  @spec name(atom(), term(), atom()) :: verdict()
  def name(kind, name, _parent) when kind in [:i2c, :gpio] do
    if is_binary(name) and name != "",
      do: :ok,
      else:
        {:error,
         "the name of #{the(kind)} must be text such as #{example(kind)}, got: #{inspect(name)}"}
  end

  def name(:device, address, :i2c) do
    if is_integer(address) and address in 0..127,
      do: :ok,
      else:
        {:error,
         "a device on #{the(:i2c)} stands at an address from 0 to 127 such as 0x68, got: #{inspect(address)}"}
  end

  # It is told what it is in the wrong place.
  def name(:device, _name, parent) when parent != :gpio, do: :ok

  def name(_kind, name, _parent) when is_atom(name) and name not in [nil, true, false], do: :ok

  def name(kind, name, _parent),
    do:
      {:error, "the name of a #{kind} must be an atom such as :my_#{kind}, got: #{inspect(name)}"}

  @doc "Whether an entity may begin inside `parent`, which is still open."
  @spec placed(atom(), atom(), Node.t()) :: verdict()
  def placed(kind, name, parent) do
    cond do
      kind not in Grammar.entities(parent.kind) -> {:error, misplaced(kind, parent.kind)}
      Grammar.named?(kind) and too_deep?(parent) -> {:error, too_deep(kind, name, parent)}
      Grammar.named?(kind) and kind != :link -> :ok
      true -> single(kind, name, parent, Node.nodes(parent, kind))
    end
  end

  # A component publishes at its path in the declaration, with a word such as :sensor for the section.
  defp too_deep?(parent), do: length(parent.path) >= Path.max_segments()

  defp too_deep(kind, name, parent) do
    "#{kind} #{inspect(name)} stands #{length(parent.path)} levels deep, and what it publishes would have a path " <>
      "of more than #{Path.max_segments()} segments; declare it further up"
  end

  defp single(_kind, _name, _parent, []), do: :ok
  defp single(:link, name, %{kind: :topology}, [first]), do: {:error, two_roots(first, name)}
  defp single(:link, name, joint, [_first]), do: {:error, two_children(joint, name)}

  defp single(kind, _name, _parent, [first]),
    do: {:error, "#{kind} is given twice, first at #{Error.place(first.place)}; keep one of them"}

  @doc "Whether the name of `node` is free; `first` is the node that has it already."
  @spec unique(Node.t(), Node.t() | nil) :: verdict()
  def unique(_node, nil), do: :ok

  def unique(%{kind: kind} = node, first) when kind in [:i2c, :gpio, :device] do
    {:error,
     """
     #{simulated(node)} is declared twice, first at #{Error.place(first.place)}; put both into \
     one, or give one another place\
     """}
  end

  def unique(node, first) do
    {:error,
     """
     #{node.kind} #{inspect(node.name)} has the name of another #{first.kind}, declared at \
     #{Error.place(first.place)}; give each a name of its own\
     """}
  end

  @doc "Checks a field of `node` which is still open: `{:ok, value}` as the schema casts it, or `{:error, reason}`."
  @spec field(Node.t(), atom(), term()) :: {:ok, term()} | {:error, String.t()}
  def field(node, field, value) do
    schema = Grammar.fields(node.kind)

    cond do
      not Keyword.has_key?(schema, field) -> {:error, unknown(field, node.kind)}
      Map.has_key?(node.fields, field) -> {:error, "#{field} is given twice; keep one of them"}
      is_struct(value, Reference) -> reference(node.kind, value)
      true -> cast(schema, field, value)
    end
  end

  defp reference(kind, value) do
    if Grammar.follows?(kind),
      do: {:ok, value},
      else: {:error, "#{the(kind)} follows no parameter; write the value itself"}
  end

  defp cast(schema, field, value) do
    case Options.validate([{field, value}], Keyword.take(schema, [field])) do
      {:ok, options} -> {:ok, options[field]}
      {:error, error} -> {:error, Exception.message(error)}
    end
  end

  @doc "Whether `node` has all it needs, now that it ends."
  @spec complete(Node.t()) :: verdict()
  def complete(%Node{kind: :joint} = joint) do
    with :ok <- typed(joint), :ok <- carrying(joint), :ok <- limited(joint), do: in_range(joint)
  end

  def complete(%Node{kind: kind, name: name, child: child} = node)
      when is_map_key(@behaviours, kind) do
    with :ok <- Child.check(child, @behaviours[kind]), :ok <- measured(node) do
      :ok
    else
      {:error, reason} -> {:error, "#{kind} #{inspect(name)}: #{reason}"}
    end
  end

  def complete(%Node{kind: :device} = node) do
    behaviour = if is_integer(node.name), do: BB.Bus.Sim.Device, else: BB.Bus.Sim.GPIO.Device

    with {:error, reason} <- Child.check(node.child, behaviour),
         do: {:error, "#{simulated(node)}: #{reason}"}
  end

  def complete(%Node{kind: :param} = node) do
    with {:ok, _definition} <- definition(node), do: :ok
  end

  def complete(%Node{kind: :settings, fields: %{parameter_store: store}}) do
    with {:error, reason} <- Child.check(store, BB.Parameter.Store),
         do: {:error, "parameter_store: #{reason}"}
  end

  def complete(_node), do: :ok

  # A component without a word on it is measured by the messages on its path.
  defp measured(%{fields: %{max_silence: _}, child: child}) do
    {:ok, module, options} = Child.parse(child)

    if Code.ensure_loaded?(module) and function_exported?(module, :max_silence, 1),
      do: ask(module, options),
      else: :ok
  end

  defp measured(_node), do: :ok

  defp ask(module, options) do
    case module.max_silence(options) do
      :ok ->
        :ok

      {:error, reason} when is_binary(reason) ->
        {:error, reason}

      other ->
        {:error, mistaken(module, "expected :ok or {:error, text}, got: #{inspect(other)}")}
    end
  catch
    kind, reason -> {:error, mistaken(module, Exception.format_banner(kind, reason))}
  end

  defp mistaken(module, what),
    do: "#{inspect(module)}.max_silence/1: #{what}; mend it, or remove max_silence"

  @doc "Whether the ring topics that a component's options name are such with the robot's prefix."
  @spec topics(Node.t(), String.t() | nil) :: verdict()
  def topics(%Node{kind: kind} = node, prefix) when is_map_key(@behaviours, kind) do
    {:ok, module, options} = Child.parse(node.child)

    names =
      if Code.ensure_loaded?(module) and function_exported?(module, :topics, 1),
        do: module.topics(options),
        else: []

    with {:error, reason} <- all(names, &topic(&1, prefix)),
         do: {:error, "#{kind} #{inspect(node.name)}: #{reason}"}
  end

  def topics(_node, _prefix), do: :ok

  defp topic(name, prefix), do: with({:ok, _topic} <- Topic.resolve(name, prefix), do: :ok)

  @doc "The parameters that a robot's declaration has, by their paths."
  @spec definitions(Node.t()) :: %{BB.Parameter.path() => Definition.t()}
  def definitions(root) do
    for section <- Node.nodes(root, :parameters), node <- params(section), into: %{} do
      {:ok, definition} = definition(node)
      {definition.path, definition}
    end
  end

  defp params(node) do
    Node.nodes(node, :param) ++ Enum.flat_map(Node.nodes(node, :group), &params/1)
  end

  defp definition(%Node{path: [:parameters | path], fields: fields}),
    do: Definition.new(path, fields)

  @doc "Whether what `node` refers to is there and fits, now that the whole robot is known."
  @spec settled(Node.t(), Node.t(), %{BB.Parameter.path() => Definition.t()}) :: verdict()
  def settled(%Node{kind: kind} = node, parent, definitions)
      when is_map_key(@behaviours, kind) do
    {:ok, _module, options} = Child.parse(node.child)

    with :ok <- connected(node, parent),
         do: all(options, fn {key, value} -> referred(key, value, definitions) end)
  end

  def settled(%Node{kind: :joint} = joint, _parent, definitions) do
    type = joint.fields.type

    with :ok <- followed(joint, :limit, Grammar.limit_fields(type), definitions),
         do:
           joint.nodes
           |> Enum.filter(&(&1.kind in Grammar.components()))
           |> all(&transmission(&1, Grammar.transmission_fields(type), definitions))
  end

  def settled(%Node{kind: kind, fields: fields}, _parent, definitions)
      when kind in [:origin, :axis],
      do: fields |> Enum.sort() |> all(&fits(&1, Grammar.fields(kind), definitions))

  def settled(%Node{kind: :device} = node, bus, _definitions) do
    {:ok, module, options} = Child.parse(node.child)

    with :ok <- all(options, &unreferred/1),
         :ok <- made(Code.ensure_loaded?(module), {module, options}, bus) do
      :ok
    else
      {:error, reason} -> {:error, "#{simulated(node)}: #{reason}"}
    end
  end

  def settled(_node, _parent, _definitions), do: :ok

  defp unreferred({key, value}) do
    case Reference.buried([value]) do
      nil ->
        :ok

      reference ->
        {:error, "option #{inspect(key)} is #{shown(reference)}; write the value itself"}
    end
  end

  # A model is pure: it can be made here as well as on its bus. One that waits for this robot to
  # compile is made later.
  defp made(false, _device, _bus), do: :ok

  defp made(true, {module, _options} = device, bus) do
    case try_out(device, bus) do
      {:raise, exception} ->
        {:error,
         "#{inspect(module)} refuses its options: #{Exception.message(exception)}; correct them"}

      # What the world lacks now, it may have then.
      _made_or_lacking ->
        :ok
    end
  end

  defp try_out(device, %{kind: :i2c}), do: Slot.new(device, 0)

  defp try_out(device, %{kind: :gpio, fields: fields}),
    do: Part.new(device, 0, Map.get(fields, :lines, @lines))

  defp connected(%{name: name, kind: kind} = node, %{kind: parent}) do
    if parent != :joint and Node.nodes(node, :transmission) != [],
      do:
        {:error,
         "#{kind} #{inspect(name)} has a transmission and stands in #{the(parent)}; move it into a joint, or remove the transmission"},
      else: :ok
  end

  defp transmission(component, schema, definitions) do
    with {:error, reason} <- followed(component, :transmission, schema, definitions),
         do: {:error, "#{component.kind} #{inspect(component.name)}: #{reason}"}
  end

  defp followed(node, kind, schema, definitions) do
    fields = Node.fields_of(node, kind) || %{}

    with {:error, reason} <- fields |> Enum.sort() |> all(&fits(&1, schema, definitions)),
         do: {:error, "#{kind}: #{reason}"}
  end

  # A parameter fits a field when its default does.
  defp fits({field, %Reference{} = reference}, schema, definitions) do
    with {:ok, definition} <- find(field, reference, definitions),
         {:error, reason} <- fits({field, definition.default}, schema, definitions) do
      {:error, "#{shown(reference)} does not fit: #{reason}"}
    else
      {:error, reason} -> {:error, reason}
      :ok -> :ok
    end
  end

  defp fits({_field, nil}, _schema, _definitions), do: :ok

  defp fits({field, value}, schema, _definitions) do
    with {:ok, _value} <- cast(schema, field, value), do: :ok
  end

  defp referred(key, %Reference{} = reference, definitions) do
    with {:ok, _definition} <- find(key, reference, definitions), do: :ok
  end

  defp referred(key, value, _definitions) do
    case Reference.buried(value) do
      nil ->
        :ok

      reference ->
        {:error,
         "option #{inspect(key)} has #{shown(reference)} inside it; a parameter stands for a whole option"}
    end
  end

  defp find(field, %Reference{path: path} = reference, definitions) do
    with :error <- Map.fetch(definitions, path),
         do:
           {:error, "#{inspect(field)} is #{shown(reference)}, and #{nothing(path, definitions)}"}
  end

  defp nothing(_path, definitions) when definitions == %{},
    do: "the robot has no parameters; declare it in `parameters`"

  defp nothing(path, definitions) do
    close =
      definitions
      |> Map.keys()
      |> Enum.max_by(&String.jaro_distance(inspect(&1), inspect(path)))

    "there is no such parameter; declare it in `parameters`, or correct the path: a close one is #{inspect(close)}"
  end

  defp shown(%Reference{path: path}), do: "param(#{inspect(path)})"

  defp all(list, rule), do: Enum.find_value(list, :ok, &with(:ok <- rule.(&1), do: nil))

  defp typed(%{fields: %{type: _}}), do: :ok

  defp typed(joint) do
    {:error,
     "joint #{inspect(joint.name)} has no type; add `type` with one of #{listed(Grammar.joint_types())}"}
  end

  defp carrying(joint) do
    if Node.nodes(joint, :link) == [],
      do: {:error, "joint #{inspect(joint.name)} has no child link; add `link :name` inside it"},
      else: :ok
  end

  defp limited(%{fields: %{type: type}} = joint) do
    if type in [:revolute, :prismatic] and Node.nodes(joint, :limit) == [],
      do: {:error, unlimited(joint, type)},
      else: :ok
  end

  defp unlimited(joint, :revolute) do
    """
    joint #{inspect(joint.name)} is :revolute and has no limit; add `limit lower: ~u(-90 degree), \
    upper: ~u(90 degree)` with its own numbers, or make it :continuous\
    """
  end

  defp unlimited(joint, :prismatic) do
    """
    joint #{inspect(joint.name)} is :prismatic and has no limit; add `limit lower: ~u(0 meter), \
    upper: ~u(0.5 meter)` with its own numbers\
    """
  end

  defp in_range(joint) do
    limit = Node.fields_of(joint, :limit) || %{}

    with :ok <- of_kinds(Enum.sort(limit), Grammar.limit_fields(joint.fields.type)),
         do: ordered(limit)
  end

  defp of_kinds([], _schema), do: :ok

  # What a parameter is, is known at the end.
  defp of_kinds([{_field, %Reference{}} | rest], schema), do: of_kinds(rest, schema)

  defp of_kinds([{field, value} | rest], schema) do
    with {:ok, _value} <- cast(schema, field, value), do: of_kinds(rest, schema)
  end

  defp ordered(%{lower: %Unit{} = lower, upper: %Unit{} = upper}) do
    if Unit.compare(lower, upper) == :gt do
      {:error,
       "limit: lower #{Unit.to_string!(lower)} is above upper #{Unit.to_string!(upper)}; swap them"}
    else
      :ok
    end
  end

  defp ordered(_limit), do: :ok

  # Words

  defp misplaced(word, kind),
    do: "#{word} cannot stand in #{the(kind)}; it belongs in #{homes(word)}"

  defp unknown(field, kind) do
    case Grammar.homes(field) do
      [] -> "#{the(kind)} has no #{inspect(field)}; it takes #{listed(Grammar.words(kind))}"
      _homes -> misplaced(field, kind)
    end
  end

  defp two_roots(first, name) do
    """
    #{inspect(name)} is a second root link beside #{inspect(first.name)}, declared at \
    #{Error.place(first.place)}; a robot has one: connect #{inspect(name)} by a joint\
    """
  end

  defp two_children(joint, name) do
    """
    #{inspect(name)} is a second child link of joint #{inspect(joint.name)}, which has one: \
    give #{inspect(name)} a joint of its own\
    """
  end

  defp simulated(%{kind: :device, name: address}) when is_integer(address),
    do: "the simulated device at 0x" <> Integer.to_string(address, 16)

  defp simulated(%{kind: :device, name: name}), do: "the simulated device #{inspect(name)}"
  defp simulated(%{name: name}), do: "the simulated #{name}"

  defp example(:i2c), do: ~s("i2c-1")
  defp example(:gpio), do: ~s("gpiochip0")

  defp the(:robot), do: "the robot itself"
  defp the(:i2c), do: "a simulated I2C bus"
  defp the(:gpio), do: "a simulated chip of lines"
  defp the(:param), do: "a parameter"

  defp the(kind)
       when kind in [:settings, :parameters, :sensors, :controllers, :topology] or
              kind in [:simulation, :dynamics],
       do: "#{kind}"

  defp the(kind) when kind in [:origin, :axis, :actuator], do: "an #{kind}"
  defp the(kind), do: "a #{kind}"

  defp homes(word), do: Enum.map_join(Grammar.homes(word), " or ", &the/1)
  defp listed([]), do: "nothing"
  defp listed(words), do: Enum.map_join(words, ", ", &inspect/1)
end
