defmodule BB.Dsl.References do
  @moduledoc """
  The rules for what an entity refers to: parameters, the joint of a transmission, and the bus of
  a simulated device. Pure.

  `BB.Dsl.Builder` checks them once the declaration is complete, because a parameter may stand
  below the references to it.
  """
  @moduledoc no_example: "internal: its mistakes are BB.Dsl.Error messages"

  alias BB.Bus.Sim.GPIO.Part
  alias BB.Bus.Sim.Place
  alias BB.Dsl.{Child, Grammar, Node}
  alias BB.Dsl.Rules
  alias BB.Parameter.{Definition, Reference}

  # The lines of a simulated chip that declares no number of lines.
  @lines 54

  @type definitions :: %{BB.Parameter.path() => Definition.t()}

  @doc "Returns the parameters of a robot's declaration, by their paths."
  @spec definitions(Node.t()) :: definitions()
  def definitions(root) do
    for section <- Node.nodes(root, :parameters), node <- params(section), into: %{} do
      {:ok, definition} = definition(node)
      {definition.path, definition}
    end
  end

  defp params(node) do
    Node.nodes(node, :param) ++ Enum.flat_map(Node.nodes(node, :group), &params/1)
  end

  @doc "Returns the definition of a `param`, or its mistake."
  @spec definition(Node.t()) :: {:ok, Definition.t()} | {:error, String.t()}
  def definition(%Node{kind: :param, path: [:parameters | path], fields: fields}),
    do: Definition.new(path, fields)

  @doc "Checks that everything to which `node` refers exists and fits."
  @spec check(Node.t(), Node.t(), definitions()) :: Rules.verdict()
  def check(%Node{kind: kind} = node, parent, definitions)
      when kind in [:sensor, :actuator, :controller] do
    {:ok, _module, options} = Child.parse(node.child)

    with :ok <- check_in_joint(node, parent),
         do: all(options, fn {key, value} -> check_option(key, value, definitions) end)
  end

  def check(%Node{kind: :joint} = joint, _parent, definitions) do
    type = joint.fields.type

    with :ok <- check_fields(joint, :limit, Grammar.limit_fields(type), definitions) do
      joint.nodes
      |> Enum.filter(&(&1.kind in Grammar.components()))
      |> all(&check_transmission(&1, Grammar.transmission_fields(type), definitions))
    end
  end

  def check(%Node{kind: kind, fields: fields}, _parent, definitions)
      when kind in [:origin, :axis],
      do: fields |> Enum.sort() |> all(&check_field(&1, Grammar.fields(kind), definitions))

  def check(%Node{kind: :device} = node, bus, _definitions) do
    {:ok, module, options} = Child.parse(node.child)

    with :ok <- all(options, &check_no_reference/1),
         :ok <- check_model(Code.ensure_loaded?(module), {module, options}, bus) do
      :ok
    else
      {:error, reason} -> {:error, "#{Node.describe(node)}: #{reason}"}
    end
  end

  def check(_node, _parent, _definitions), do: :ok

  defp check_in_joint(%{name: name, kind: kind} = node, %{kind: parent}) do
    if parent != :joint and Node.nodes(node, :transmission) != [] do
      {:error,
       "#{kind} #{inspect(name)} has a transmission and stands in " <>
         "#{Grammar.describe(parent)}; move it into a joint, or remove the transmission"}
    else
      :ok
    end
  end

  # Fields of entities

  defp check_transmission(component, schema, definitions) do
    with {:error, reason} <- check_fields(component, :transmission, schema, definitions),
         do: {:error, "#{component.kind} #{inspect(component.name)}: #{reason}"}
  end

  defp check_fields(node, kind, schema, definitions) do
    fields = Node.fields_of(node, kind) || %{}

    with {:error, reason} <- fields |> Enum.sort() |> all(&check_field(&1, schema, definitions)),
         do: {:error, "#{kind}: #{reason}"}
  end

  # A parameter fits a field when its default does.
  defp check_field({field, %Reference{} = reference}, schema, definitions) do
    with {:ok, definition} <- find(field, reference, definitions),
         {:error, reason} <- check_field({field, definition.default}, schema, definitions) do
      {:error, "#{show(reference)} does not fit: #{reason}"}
    else
      {:error, reason} -> {:error, reason}
      :ok -> :ok
    end
  end

  defp check_field({_field, nil}, _schema, _definitions), do: :ok

  defp check_field({field, value}, schema, _definitions) do
    with {:ok, _value} <- Grammar.cast(schema, field, value), do: :ok
  end

  # Options of components

  defp check_option(key, %Reference{} = reference, definitions) do
    with {:ok, _definition} <- find(key, reference, definitions), do: :ok
  end

  defp check_option(key, value, _definitions) do
    case Reference.buried(value) do
      nil ->
        :ok

      reference ->
        {:error,
         "option #{inspect(key)} has #{show(reference)} inside it; " <>
           "a parameter stands for a whole option"}
    end
  end

  defp find(field, %Reference{path: path} = reference, definitions) do
    with :error <- Map.fetch(definitions, path) do
      {:error, "#{inspect(field)} is #{show(reference)}, and #{not_found(path, definitions)}"}
    end
  end

  defp not_found(_path, definitions) when definitions == %{},
    do: "the robot has no parameters; declare it in `parameters`"

  defp not_found(path, definitions) do
    close =
      definitions
      |> Map.keys()
      |> Enum.max_by(&String.jaro_distance(inspect(&1), inspect(path)))

    "the robot has no such parameter; declare it in `parameters`, or correct the path: " <>
      "a close one is #{inspect(close)}"
  end

  # Simulated devices

  defp check_no_reference({key, value}) do
    case Reference.buried([value]) do
      nil ->
        :ok

      reference ->
        {:error, "option #{inspect(key)} is #{show(reference)}; write the value itself"}
    end
  end

  # A simulated device is pure, so it can be made here as well as on its bus. A module that waits
  # for this robot to compile is made later.
  defp check_model(false, _device, _bus), do: :ok

  defp check_model(true, {module, _options} = device, bus) do
    case make(device, bus) do
      {:raise, exception} ->
        {:error,
         "#{inspect(module)} refuses its options: #{Exception.message(exception)}; correct them"}

      # Whatever else is missing now may exist when the bus starts.
      _made_or_missing ->
        :ok
    end
  end

  defp make(device, %{kind: :i2c}), do: Place.new(device, 0)

  defp make(device, %{kind: :gpio, fields: fields}),
    do: Part.new(device, 0, Map.get(fields, :lines, @lines))

  defp show(%Reference{path: path}), do: "param(#{inspect(path)})"

  defp all(list, check), do: Enum.find_value(list, :ok, &with(:ok <- check.(&1), do: nil))
end
