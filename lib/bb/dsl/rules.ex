defmodule BB.Dsl.Rules do
  @moduledoc """
  The rules that each entity of a declaration keeps by itself. Pure.

  `BB.Dsl.Builder` checks them when an entity begins, gets a field, or ends. Each check returns
  `:ok` or `{:error, reason}` with the mistake and its remedy. `BB.Dsl.References` has the rules
  that need the whole declaration.

      iex> BB.Dsl.Rules.check_name(:link, "arm", :topology)
      {:error, ~s(the name of a link must be an atom such as :my_link, got: "arm")}
  """

  alias BB.Dsl.{Child, Error, Grammar, Node, References}
  alias BB.Parameter.Reference
  alias BB.{Path, Topic, Unit}

  @behaviours %{sensor: BB.Sensor, actuator: BB.Actuator, controller: BB.Controller}

  @type verdict :: :ok | {:error, String.t()}

  @doc "Checks the name of an entity of `kind` inside an entity of the kind `parent`."
  @spec check_name(atom(), term(), atom()) :: verdict()
  def check_name(kind, name, _parent) when kind in [:i2c, :gpio] do
    if is_binary(name) and name != "" do
      :ok
    else
      {:error,
       "the name of #{Grammar.describe(kind)} must be a string such as #{example(kind)}, " <>
         "got: #{inspect(name)}"}
    end
  end

  def check_name(:device, address, :i2c) do
    if is_integer(address) and address in 0..127 do
      :ok
    else
      {:error,
       "a device on #{Grammar.describe(:i2c)} stands at an address from 0 to 127 " <>
         "such as 0x68, got: #{inspect(address)}"}
    end
  end

  # check_place/3 refuses a device outside of a bus.
  def check_name(:device, _name, parent) when parent != :gpio, do: :ok

  def check_name(_kind, name, _parent)
      when is_atom(name) and name not in [nil, true, false],
      do: :ok

  def check_name(kind, name, _parent) do
    {:error, "the name of a #{kind} must be an atom such as :my_#{kind}, got: #{inspect(name)}"}
  end

  @doc "Checks that an entity may stand inside `parent`, which is still open."
  @spec check_place(atom(), atom(), Node.t()) :: verdict()
  def check_place(kind, name, parent) do
    cond do
      kind not in Grammar.entities(parent.kind) -> {:error, misplaced(kind, parent.kind)}
      Grammar.named?(kind) and too_deep?(parent) -> {:error, too_deep(kind, name, parent)}
      Grammar.named?(kind) and kind != :link -> :ok
      true -> check_single(kind, name, parent, Node.nodes(parent, kind))
    end
  end

  # The path of a component's messages is a word such as :sensor and its path in the declaration.
  defp too_deep?(parent), do: length(parent.path) >= Path.max_segments()

  defp too_deep(kind, name, parent) do
    "#{kind} #{inspect(name)} stands #{length(parent.path)} levels deep, and the path of its " <>
      "messages would have more than #{Path.max_segments()} segments; declare it further up"
  end

  defp check_single(_kind, _name, _parent, []), do: :ok

  defp check_single(:link, name, %{kind: :topology}, [first]),
    do: {:error, two_roots(first, name)}

  defp check_single(:link, name, joint, [_first]), do: {:error, two_children(joint, name)}

  defp check_single(kind, _name, _parent, [first]),
    do: {:error, "#{kind} is given twice, first at #{Error.place(first.place)}; keep one of them"}

  @doc "Checks that the name of `node` is free; `first` is the node that already has it."
  @spec check_unique(Node.t(), Node.t() | nil) :: verdict()
  def check_unique(_node, nil), do: :ok

  def check_unique(%{kind: kind} = node, first) when kind in [:i2c, :gpio, :device] do
    {:error,
     """
     #{Node.describe(node)} is declared twice, first at #{Error.place(first.place)}; put both \
     into one, or give one another place\
     """}
  end

  def check_unique(node, first) do
    {:error,
     """
     #{node.kind} #{inspect(node.name)} has the name of another #{first.kind}, declared at \
     #{Error.place(first.place)}; give each a name of its own\
     """}
  end

  @doc """
  Checks a field of `node`, which is still open. Returns `{:ok, value}` with the value that the
  schema casts it to, or `{:error, reason}`.
  """
  @spec check_field(Node.t(), atom(), term()) :: {:ok, term()} | {:error, String.t()}
  def check_field(node, field, value) do
    schema = Grammar.fields(node.kind)

    cond do
      not Keyword.has_key?(schema, field) -> {:error, unknown(field, node.kind)}
      Map.has_key?(node.fields, field) -> {:error, "#{field} is given twice; keep one of them"}
      is_struct(value, Reference) -> check_reference(node.kind, value)
      true -> Grammar.cast(schema, field, value)
    end
  end

  defp check_reference(kind, value) do
    if Grammar.follows?(kind),
      do: {:ok, value},
      else: {:error, "#{Grammar.describe(kind)} follows no parameter; write the value itself"}
  end

  @doc "Checks that `node`, which ends, has everything that it needs."
  @spec check_complete(Node.t()) :: verdict()
  def check_complete(%Node{kind: :joint} = joint) do
    with :ok <- check_type(joint),
         :ok <- check_child_link(joint),
         :ok <- check_limited(joint),
         do: check_range(joint)
  end

  def check_complete(%Node{kind: kind, name: name, child: child} = node)
      when is_map_key(@behaviours, kind) do
    with :ok <- Child.check(child, @behaviours[kind]), :ok <- check_max_silence(node) do
      :ok
    else
      {:error, reason} -> {:error, "#{kind} #{inspect(name)}: #{reason}"}
    end
  end

  def check_complete(%Node{kind: :device} = node) do
    behaviour = if is_integer(node.name), do: BB.Bus.Sim.Device, else: BB.Bus.Sim.GPIO.Device

    with {:error, reason} <- Child.check(node.child, behaviour),
         do: {:error, "#{Node.describe(node)}: #{reason}"}
  end

  def check_complete(%Node{kind: :param} = node) do
    with {:ok, _definition} <- References.definition(node), do: :ok
  end

  def check_complete(%Node{kind: :settings, fields: %{parameter_store: store}}) do
    with {:error, reason} <- Child.check(store, BB.Parameter.Store),
         do: {:error, "parameter_store: #{reason}"}
  end

  def check_complete(_node), do: :ok

  # A component without the callback measures its silence by the messages on its path.
  defp check_max_silence(%{fields: %{max_silence: _}, child: child}) do
    {:ok, module, options} = Child.parse(child)

    if Code.ensure_loaded?(module) and function_exported?(module, :max_silence, 1),
      do: call_max_silence(module, options),
      else: :ok
  end

  defp check_max_silence(_node), do: :ok

  defp call_max_silence(module, options) do
    case module.max_silence(options) do
      :ok ->
        :ok

      {:error, reason} when is_binary(reason) ->
        {:error, reason}

      other ->
        {:error, bad_callback(module, "expected :ok or {:error, text}, got: #{inspect(other)}")}
    end
  catch
    kind, reason -> {:error, bad_callback(module, Exception.format_banner(kind, reason))}
  end

  defp bad_callback(module, mistake),
    do: "#{inspect(module)}.max_silence/1: #{mistake}; correct it, or remove max_silence"

  @doc "Checks the ring topics in the options of a component, with its topic prefix."
  @spec check_topics(Node.t(), String.t() | nil) :: verdict()
  def check_topics(%Node{kind: kind} = node, prefix) when is_map_key(@behaviours, kind) do
    {:ok, module, options} = Child.parse(node.child)

    names =
      if Code.ensure_loaded?(module) and function_exported?(module, :topics, 1),
        do: module.topics(options),
        else: []

    with {:error, reason} <- Enum.find_value(names, :ok, &topic_error(&1, prefix)),
         do: {:error, "#{kind} #{inspect(node.name)}: #{reason}"}
  end

  def check_topics(_node, _prefix), do: :ok

  defp topic_error(name, prefix),
    do: with({:ok, _topic} <- Topic.resolve(name, prefix), do: nil)

  # Joints

  defp check_type(%{fields: %{type: _}}), do: :ok

  defp check_type(joint) do
    {:error,
     "joint #{inspect(joint.name)} has no type; " <>
       "add `type` with one of #{list(Grammar.joint_types())}"}
  end

  defp check_child_link(joint) do
    if Node.nodes(joint, :link) == [],
      do: {:error, "joint #{inspect(joint.name)} has no child link; add `link :name` inside it"},
      else: :ok
  end

  defp check_limited(%{fields: %{type: type}} = joint) do
    if type in [:revolute, :prismatic] and Node.nodes(joint, :limit) == [],
      do: {:error, unlimited(joint, type)},
      else: :ok
  end

  defp unlimited(joint, :revolute) do
    """
    joint #{inspect(joint.name)} is :revolute and has no limit; add \
    `limit lower: ~u(-90 degree), upper: ~u(90 degree)` with its own numbers, or make it \
    :continuous\
    """
  end

  defp unlimited(joint, :prismatic) do
    """
    joint #{inspect(joint.name)} is :prismatic and has no limit; add `limit lower: ~u(0 meter), \
    upper: ~u(0.5 meter)` with its own numbers\
    """
  end

  defp check_range(joint) do
    limit = Node.fields_of(joint, :limit) || %{}

    with :ok <- check_units(Enum.sort(limit), Grammar.limit_fields(joint.fields.type)),
         do: check_order(limit)
  end

  defp check_units([], _schema), do: :ok

  # BB.Dsl.References checks references, once all parameters are known.
  defp check_units([{_field, %Reference{}} | rest], schema), do: check_units(rest, schema)

  defp check_units([{field, value} | rest], schema) do
    with {:ok, _value} <- Grammar.cast(schema, field, value), do: check_units(rest, schema)
  end

  defp check_order(%{lower: %Unit{} = lower, upper: %Unit{} = upper}) do
    if Unit.compare(lower, upper) == :gt do
      {:error,
       "limit: lower #{Unit.to_string!(lower)} is above upper #{Unit.to_string!(upper)}; " <>
         "swap them"}
    else
      :ok
    end
  end

  defp check_order(_limit), do: :ok

  # Messages

  defp misplaced(word, kind) do
    homes = Enum.map_join(Grammar.homes(word), " or ", &Grammar.describe/1)
    "#{word} cannot stand in #{Grammar.describe(kind)}; it belongs in #{homes}"
  end

  defp unknown(field, kind) do
    case Grammar.homes(field) do
      [] ->
        "#{Grammar.describe(kind)} has no #{inspect(field)}; it takes " <>
          "#{list(Grammar.words(kind))}"

      _homes ->
        misplaced(field, kind)
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

  defp example(:i2c), do: ~s("i2c-1")
  defp example(:gpio), do: ~s("gpiochip0")

  defp list([]), do: "nothing"
  defp list(words), do: Enum.map_join(words, ", ", &inspect/1)
end
