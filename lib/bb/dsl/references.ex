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
  alias BB.Dsl.{Child, Fields, Joints, Node, Quantities, Rules}
  alias BB.Parameter.{Definition, Reference}

  # The lines of a simulated chip that declares no number of lines.
  @lines 54

  @type definitions :: %{BB.Parameter.path() => Definition.t()}

  @doc "Returns the parameters of a robot's declaration, by their paths."
  @spec definitions(Node.t()) :: definitions()
  def definitions(root) do
    for %Node{kind: :param} = node <- Node.all(root), into: %{} do
      {:ok, definition} = definition(node)
      {definition.path, definition}
    end
  end

  @doc "Returns the definition of a `param`, or its mistake."
  @spec definition(Node.t()) :: {:ok, Definition.t()} | {:error, String.t()}
  def definition(%Node{kind: :param, path: [:parameters | path], fields: fields}),
    do: Definition.new(path, fields)

  @doc "Checks that everything to which `node` refers exists and fits."
  @spec check(Node.t(), Node.t(), definitions()) :: Rules.verdict()
  def check(%Node{kind: kind} = node, _parent, definitions)
      when kind in [:sensor, :actuator, :controller, :bridge, :estimator] do
    {:ok, _module, options} = Child.parse(node.child)
    all(options, fn {key, value} -> check_option(key, value, definitions) end)
  end

  def check(%Node{kind: :joint, fields: %{type: type}} = joint, _parent, definitions) do
    all(Joints.measured(joint), fn {node, words} ->
      with {:error, reason} <- check_fields(node, type, definitions),
           do: {:error, words <> reason}
    end)
  end

  def check(%Node{kind: :device} = node, bus, _definitions) do
    {:ok, module, options} = Child.parse(node.child)

    with :ok <- all(options, &check_no_reference/1),
         :ok <- check_model(Code.ensure_loaded?(module), {module, options}, bus) do
      :ok
    else
      {:error, reason} -> {:error, "#{Node.describe(node)}: #{reason}"}
    end
  end

  # A joint checks these itself, with its type.
  def check(%Node{kind: kind, parent: parent}, _parent, _definitions)
      when kind in [:limit, :dynamics] or (kind == :transmission and parent == :joint),
      do: :ok

  def check(%Node{} = node, _parent, definitions), do: check_fields(node, nil, definitions)

  # Fields of entities. A parameter fits a field when its default does.

  defp check_fields(node, type, definitions) do
    node.fields
    |> Enum.sort()
    |> all(fn
      {field, %Reference{} = reference} -> check_field(node, field, reference, type, definitions)
      _value -> :ok
    end)
  end

  defp check_field(node, field, reference, type, definitions) do
    with {:ok, definition} <- find(field, reference, definitions),
         {:error, reason} <- check_value(node.kind, field, definition.default, type) do
      {:error, "#{show(reference)} does not fit: #{reason}"}
    else
      {:error, reason} -> {:error, reason}
      :ok -> :ok
    end
  end

  defp check_value(_kind, _field, nil, _type), do: :ok

  defp check_value(kind, field, value, type) do
    with {:ok, value} <- Fields.cast(Fields.of(kind), field, value),
         do: Quantities.check(field, value, type)
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
