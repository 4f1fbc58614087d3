defmodule BB.Dsl.Commands do
  @moduledoc """
  The rules for the commands, categories and states of a robot, and what they come to. Pure.
  `BB.Dsl.Builder` checks them, `BB.Dsl.Info` returns their results.

      iex> BB.Dsl.Commands.states([%BB.Dsl.State{name: :recording}]) |> Enum.map(& &1.name)
      [:idle, :recording]
  """

  alias BB.Dsl.{Category, Child, Command, Node, State}

  # The handlers that arm and disarm, which set the flag of their command.
  @flags %{
    arm: Module.concat(["BB", "Command", "Arm"]),
    disarm: Module.concat(["BB", "Command", "Disarm"])
  }

  @doc "Checks a command of a complete declaration."
  @spec check(Node.t(), Node.t()) :: :ok | {:error, String.t()}
  def check(%Node{kind: :command} = node, root) do
    with :ok <- check_one_flag(node),
         :ok <- check_first(node, root, :arm),
         :ok <- check_first(node, root, :disarm),
         :ok <- check_arm_states(node),
         do: check_disarm_states(node)
  end

  def check(_node, _root), do: :ok

  defp check_one_flag(node) do
    if flag?(node, :arm) and flag?(node, :disarm) do
      {:error, "#{Node.describe(node)} has both `arm true` and `disarm true`; keep one"}
    else
      :ok
    end
  end

  defp check_first(node, root, flag) do
    case root |> Node.in_sections(:commands, :command) |> Enum.filter(&flag?(&1, flag)) do
      [first, %{name: name} | _] when name == node.name ->
        {:error,
         "Multiple commands have `#{flag} true`: #{inspect(first.name)} and " <>
           "#{inspect(name)}; keep it in one of them"}

      _ ->
        :ok
    end
  end

  defp check_arm_states(node) do
    if flag?(node, :arm) and not Enum.any?([:disarmed, :*], &(&1 in allowed_states(node))) do
      {:error,
       "allowed_states of #{Node.describe(node)}, which arms the robot, must include " <>
         ":disarmed; add `allowed_states [:disarmed]`"}
    else
      :ok
    end
  end

  defp check_disarm_states(node) do
    if flag?(node, :disarm) and allowed_states(node) -- [:disarmed] == [] do
      {:error,
       "#{Node.describe(node)}, which disarms the robot, must be runnable from an armed " <>
         "state; add `allowed_states [:idle]` or `:*`"}
    else
      :ok
    end
  end

  defp allowed_states(node), do: Map.get(node.fields, :allowed_states, [:idle])

  defp flag?(node, flag), do: flag?(node.fields[flag], node.fields[:handler], flag)

  defp flag?(true, _handler, _flag), do: true

  defp flag?(_flag, handler, flag) do
    case Child.parse(handler) do
      {:ok, module, _options} -> module == @flags[flag]
      _ -> false
    end
  end

  @doc "Returns a command with the flags that its handler sets."
  @spec flagged(Command.t()) :: Command.t()
  def flagged(%Command{} = command) do
    %{
      command
      | arm: flag?(command.arm, command.handler, :arm),
        disarm: flag?(command.disarm, command.handler, :disarm)
    }
  end

  @doc "Returns the states of a robot: `:idle`, and those that it declares."
  @spec states([State.t()]) :: [State.t()]
  def states(declared) do
    if Enum.any?(declared, &(&1.name == :idle)),
      do: declared,
      else: [%State{name: :idle, doc: "Armed, and executing nothing."} | declared]
  end

  @doc "Returns the categories of a robot: `:default`, and those that it declares."
  @spec categories([Category.t()]) :: [Category.t()]
  def categories(declared) do
    if Enum.any?(declared, &(&1.name == :default)),
      do: declared,
      else: [%Category{name: :default, doc: "Commands without a category."} | declared]
  end
end
