defmodule BB.Dsl.Rules do
  @moduledoc """
  The rules that each entity of a declaration keeps by itself. Pure.

  `BB.Dsl.Builder` checks them when an entity begins, gets a field, or ends. Each check returns
  `:ok` or `{:error, reason}` with the mistake and its remedy. `BB.Dsl.Joints` has the rules for
  joints, `BB.Dsl.References` and `BB.Dsl.Commands` those that need the whole declaration.

      iex> BB.Dsl.Rules.check_name(:link, "arm", :topology)
      {:error, ~s(the name of a link must be an atom such as :my_link, got: "arm")}
  """

  alias BB.Dsl.{Child, Error, Fields, Grammar, Joints, Node, References}
  alias BB.Parameter.Reference
  alias BB.{Path, Topic}

  @behaviours %{
    sensor: BB.Sensor,
    actuator: BB.Actuator,
    controller: BB.Controller,
    bridge: Module.concat(["BB", "Bridge"]),
    estimator: Module.concat(["BB", "Estimator"])
  }

  @reserved_states BB.Dsl.State.reserved_names()

  @type verdict :: :ok | {:error, String.t()}

  @doc "Returns the behaviour of an entity's child, or `nil` for an entity without one."
  @spec behaviour(atom()) :: module() | nil
  def behaviour(kind), do: @behaviours[kind]

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

  def check_name(:state, name, _parent) when name in @reserved_states do
    {:error,
     """
     Cannot define a state named #{inspect(name)}: the name belongs to the safety system; \
     give the state another name\
     """}
  end

  def check_name(_kind, name, _parent)
      when is_atom(name) and name not in [nil, true, false],
      do: :ok

  def check_name(kind, name, _parent) do
    {:error, "the name of a #{kind} must be an atom such as :my_#{kind}, got: #{inspect(name)}"}
  end

  @doc """
  Checks that an entity may stand inside `parent`, which is still open. `roots` are the root
  links so far.
  """
  @spec check_place(atom(), atom(), Node.t(), [Node.t()]) :: verdict()
  def check_place(kind, name, parent, roots) do
    cond do
      kind not in Grammar.entities(parent.kind) -> {:error, misplaced(kind, parent.kind)}
      inputs_of_sensor?(kind, parent) -> {:error, no_inputs(kind)}
      Grammar.named?(kind) and too_deep?(parent) -> {:error, too_deep(kind, name, parent)}
      kind == :link and parent.kind == :topology -> check_root(name, roots)
      true -> check_single(kind, name, parent)
    end
  end

  # An estimator in a sensor has one input, the sensor.
  defp inputs_of_sensor?(kind, parent),
    do: kind == :input and parent.kind == :estimator and parent.parent == :sensor

  defp no_inputs(kind) do
    "#{kind} cannot stand in an estimator of a sensor, whose input is the sensor; " <>
      "move the estimator into the link"
  end

  # The path of a component's messages is a word such as :sensor and its path in the declaration.
  defp too_deep?(parent), do: length(parent.path) >= Path.max_segments()

  defp too_deep(kind, name, parent) do
    "#{kind} #{inspect(name)} stands #{length(parent.path)} levels deep, and the path of its " <>
      "messages would have more than #{Path.max_segments()} segments; declare it further up"
  end

  defp check_root(_name, []), do: :ok

  defp check_root(name, [first | _]) do
    {:error,
     """
     There can only be one link at the root: #{inspect(name)} is a second one beside \
     #{inspect(first.name)}, declared at #{Error.place(first.place)}; connect \
     #{inspect(name)} by a joint\
     """}
  end

  defp check_single(kind, name, parent) do
    case Grammar.holds(parent.kind)[kind] do
      {:many, _key} -> :ok
      {:one, key} -> check_single(kind, name, parent, occupants(parent, key))
    end
  end

  defp check_single(_kind, _name, _parent, []), do: :ok
  defp check_single(:link, name, joint, [_first]), do: {:error, two_children(joint, name)}

  defp check_single(kind, _name, _parent, [%{kind: kind} = first]),
    do: {:error, "#{kind} is given twice, first at #{Error.place(first.place)}; keep one of them"}

  defp check_single(kind, _name, parent, [first]) do
    {:error,
     "#{kind} is a second shape of #{Node.describe(parent)} beside #{first.kind}, given at " <>
       "#{Error.place(first.place)}; keep one of them"}
  end

  defp occupants(parent, key) do
    holds = Grammar.holds(parent.kind)
    Enum.filter(parent.nodes, &(elem(holds[&1.kind], 1) == key))
  end

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
     duplicate name #{inspect(node.name)}: #{Node.describe(node)} has the name of a \
     #{first.kind}, declared at #{Error.place(first.place)}; give each a name of its own\
     """}
  end

  @doc """
  Checks a field of `node`, which is still open. Returns `{:ok, value}` with the value that the
  schema casts it to, or `{:error, reason}`. `taken` are the fields that it has.
  """
  @spec check_field(Node.t(), atom(), term(), map()) :: {:ok, term()} | {:error, String.t()}
  def check_field(node, field, value, taken) do
    schema = Fields.of(node.kind)

    cond do
      not Keyword.has_key?(schema, field) -> {:error, unknown(field, node.kind)}
      Map.has_key?(taken, field) -> {:error, "#{field} is given twice; keep one of them"}
      is_struct(value, Reference) -> check_reference(node, value)
      true -> Fields.cast(schema, field, value)
    end
  end

  defp check_reference(node, value) do
    if Grammar.follows?(node.kind) and node.parent not in [:visual, :collision],
      do: {:ok, value},
      else:
        {:error, "#{Grammar.describe(node.kind)} follows no parameter; write the value itself"}
  end

  @doc "Checks that `node`, which ends, has everything that it needs."
  @spec check_complete(Node.t()) :: verdict()
  def check_complete(%Node{kind: kind} = node) do
    case Enum.find(Fields.required(kind), &(not Map.has_key?(node.fields, &1))) do
      nil -> check_whole(node)
      field -> {:error, "#{Node.describe(node)} has no #{field}; add `#{field}` to it"}
    end
  end

  defp check_whole(%Node{kind: :joint} = joint), do: Joints.check(joint)
  defp check_whole(%Node{kind: :axis} = axis), do: Joints.check_axis(axis)

  defp check_whole(%Node{kind: kind, child: child} = node) when is_map_key(@behaviours, kind) do
    with :ok <- Child.check_if_loaded(child, @behaviours[kind]), :ok <- check_max_silence(node) do
      :ok
    else
      {:error, reason} -> {:error, "#{Node.describe(node)}: #{reason}"}
    end
  end

  defp check_whole(%Node{kind: :command, fields: %{handler: handler}} = node) do
    with {:error, reason} <- Child.check_constant(handler),
         do: {:error, "#{Node.describe(node)}: #{reason}"}
  end

  defp check_whole(%Node{kind: :device} = node) do
    behaviour = if is_integer(node.name), do: BB.Bus.Sim.Device, else: BB.Bus.Sim.GPIO.Device

    with {:error, reason} <- Child.check(node.child, behaviour),
         do: {:error, "#{Node.describe(node)}: #{reason}"}
  end

  defp check_whole(%Node{kind: :param} = node) do
    with {:ok, _definition} <- References.definition(node), do: :ok
  end

  defp check_whole(%Node{kind: :settings, fields: %{parameter_store: store}})
       when store != nil do
    with {:error, reason} <- Child.check(store, BB.Parameter.Store),
         do: {:error, "parameter_store: #{reason}"}
  end

  defp check_whole(_node), do: :ok

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
  def check_topics(%Node{kind: kind} = node, prefix)
      when kind in [:sensor, :actuator, :controller] do
    {:ok, module, options} = Child.parse(node.child)

    names =
      if Code.ensure_loaded?(module) and function_exported?(module, :topics, 1),
        do: module.topics(options),
        else: []

    with {:error, reason} <- Enum.find_value(names, :ok, &topic_error(&1, prefix)),
         do: {:error, "#{Node.describe(node)}: #{reason}"}
  end

  def check_topics(_node, _prefix), do: :ok

  defp topic_error(name, prefix),
    do: with({:ok, _topic} <- Topic.resolve(name, prefix), do: nil)

  # Messages

  @doc "Returns the mistake of a word that cannot stand in an entity of `kind`."
  @spec unknown(atom(), atom()) :: String.t()
  def unknown(word, kind) do
    case Grammar.homes(word) do
      [] ->
        "#{Grammar.describe(kind)} has no #{inspect(word)}; it takes #{list(Grammar.words(kind))}"

      homes ->
        if kind in homes,
          do: "#{word} has a wrong number of arguments; see the documentation of BB.Dsl",
          else: misplaced(word, kind)
    end
  end

  defp misplaced(word, kind) do
    homes = Enum.map_join(Grammar.homes(word), " or ", &Grammar.describe/1)

    "#{word} cannot stand in #{Grammar.describe(kind)}; it belongs in #{homes} " <>
      "(#{Grammar.describe(kind)} takes #{list(Grammar.words(kind))})"
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
