defmodule BB.Dsl.Warnings do
  @moduledoc """
  The warnings about a robot's declaration: what compiles, and is probably a mistake.

  `BB.Dsl.Builder` prints them on standard error when a robot's module compiles: a module that
  cannot be loaded, options that its schema refuses, a joint whose position nobody reports,
  states and categories that do not exist, a transmission where there is no joint.
  """
  @moduledoc no_example: "internal: the compiler prints its warnings"

  alias BB.Dsl.{Child, Driver, Functions, Grammar, Node}

  @set_state Module.concat(["BB", "Command", "SetState"])

  # The states that a robot has without declaring them.
  @states [:idle, :executing, :disarmed, :*]

  @doc "Prints the warnings about a complete declaration."
  @spec print(module(), Node.t()) :: :ok
  def print(module, root) do
    for node <- Node.all(root), text <- texts(node, root) do
      place = [module: module, file: node.place.file, line: node.place.line]
      IO.warn("#{inspect(module)}: #{text}", place)
    end

    :ok
  end

  @doc "Returns the warnings about one entity of a complete declaration."
  @spec texts(Node.t(), Node.t()) :: [String.t()]
  def texts(%Node{kind: kind} = node, _root)
      when kind in [:sensor, :actuator, :controller, :bridge, :estimator],
      do: child_texts(node) ++ transmission_texts(node)

  def texts(%Node{kind: :joint} = joint, _root), do: silent_joint(joint)

  def texts(%Node{kind: :states, fields: %{initial_state: state}}, root) do
    if state in states(root),
      do: [],
      else: ["Invalid initial_state #{inspect(state)}: #{undeclared_state(state)}"]
  end

  def texts(%Node{kind: :command} = command, root),
    do: state_texts(command, root) ++ target_texts(command, root) ++ category_texts(command, root)

  def texts(_node, _root), do: []

  # Children

  defp child_texts(node) do
    {:ok, module, options} = Child.parse(node.child)

    case Code.ensure_compiled(module) do
      {:module, _} -> option_texts(node, module, options)
      # The module waits for this robot to compile.
      {:error, :unavailable} -> []
      {:error, _} -> [unloadable(node, module)]
    end
  end

  defp unloadable(node, module) do
    """
    #{Node.describe(node)}: module #{inspect(module)} cannot be loaded, and is checked when the \
    robot starts; correct its name if it is misspelt\
    """
  end

  defp option_texts(node, module, options) do
    with true <- function_exported?(module, :options_schema, 0),
         true <- Enum.all?(modules(options), &compiled?/1),
         {:error, error} <- Driver.check(module, options) do
      reason = Exception.message(error)
      ["#{Node.describe(node)}: wrong options for #{inspect(module)}: #{reason}"]
    else
      _right_or_unknown -> []
    end
  end

  # The modules that a schema may ask for what they implement.
  defp modules(value) when is_atom(value),
    do: if(String.starts_with?(Atom.to_string(value), "Elixir."), do: [value], else: [])

  # A function of the robot's own module is there when the robot runs.
  defp modules(value) when is_function(value),
    do: if(Functions.lifted?(value), do: [], else: [Function.info(value)[:module]])

  defp modules([head | tail]), do: modules(head) ++ modules(tail)
  defp modules(value) when is_tuple(value), do: value |> Tuple.to_list() |> modules()
  defp modules(_value), do: []

  # Waits for a module of the same project; one that waits for this robot is unavailable.
  defp compiled?(module), do: Code.ensure_compiled(module) != {:error, :unavailable}

  defp transmission_texts(%{parent: :joint}), do: []

  defp transmission_texts(node) do
    if Node.nodes(node, :transmission) == [] do
      []
    else
      [
        "#{Node.describe(node)} has a transmission and stands in " <>
          "#{Grammar.describe(node.parent)}, where nothing uses it; move it into a joint, or " <>
          "remove the transmission"
      ]
    end
  end

  # Joints

  defp silent_joint(%{fields: %{type: type}} = joint) when type not in [:fixed, :continuous] do
    actuators = Node.nodes(joint, :actuator)

    if actuators == [] or Node.nodes(joint, :sensor) != [] or Enum.any?(actuators, &reports?/1),
      do: [],
      else: [silent(joint, actuators)]
  end

  defp silent_joint(_joint), do: []

  defp silent(joint, actuators) do
    names = actuators |> Enum.map(& &1.name) |> Enum.sort() |> Enum.map_join(", ", &inspect/1)

    """
    #{Node.describe(joint)} is driven by #{names} but nothing reports where it is; add a sensor \
    to the joint, such as BB.Sensor.OpenLoopPositionEstimator, or \
    `def capabilities(_opts), do: [:position_feedback]` to a driver that reports it\
    """
  end

  defp reports?(actuator) do
    {:ok, module, options} = Child.parse(actuator.child)
    Driver.reports_position?(module, options)
  end

  # Commands and states

  defp state_texts(command, root) do
    case Map.get(command.fields, :allowed_states, []) -- states(root) do
      [] ->
        []

      unknown ->
        [
          "#{Node.describe(command)} references undefined states #{inspect(unknown)}; " <>
            "declare them in `states`"
        ]
    end
  end

  defp target_texts(command, root) do
    case command.fields.handler do
      {@set_state, [_ | _] = options} ->
        state = options[:to]

        if state == nil or state in states(root),
          do: [],
          else: [
            "#{Node.describe(command)} targets undefined state #{inspect(state)}: " <>
              undeclared_state(state)
          ]

      _handler ->
        []
    end
  end

  defp category_texts(command, root) do
    known = [:default, :*, nil | names(root, :commands, :category)]
    used = [command.fields[:category] | Map.get(command.fields, :cancel, [])]

    for category <- Enum.uniq(used) -- known do
      "#{Node.describe(command)} references undefined category #{inspect(category)}; " <>
        "declare it in `commands`"
    end
  end

  defp undeclared_state(state), do: "declare `state #{inspect(state)}` in `states`"
  defp states(root), do: @states ++ names(root, :states, :state)

  defp names(root, section, kind),
    do: for(node <- Node.in_sections(root, section, kind), do: node.name)
end
