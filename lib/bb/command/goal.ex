defmodule BB.Command.Goal do
  @moduledoc """
  Completes the goal of a command by the arguments that the command declares. Pure.
  `BB.Robot.Runtime.execute/3` uses it.

      iex> arguments = [
      ...>   %BB.Dsl.Command.Argument{name: :angle, type: :float, required: true},
      ...>   %BB.Dsl.Command.Argument{name: :speed, type: {:in, [:slow, :fast]}, default: :slow}
      ...> ]
      iex> BB.Command.Goal.coerce(%{angle: "1.5"}, arguments)
      %{angle: 1.5, speed: :slow}
  """

  alias BB.Dsl.Command
  alias BB.Dsl.Command.Argument
  alias BB.Error.Invalid

  @doc """
  Turns strings, which come from forms, into values of the arguments' types, and adds defaults.

  A string that cannot be parsed does not change, and neither does a key without an argument. An
  atom is never made: `:atom` takes names of atoms that exist.
  """
  @spec coerce(map() | keyword(), [Argument.t()]) :: map()
  def coerce(goal, arguments) do
    Enum.reduce(arguments, Map.new(goal), &put_argument/2)
  end

  defp put_argument(%Argument{name: name, type: type, default: default}, goal) do
    case goal do
      %{^name => text} when is_binary(text) -> %{goal | name => parse(type, text)}
      %{^name => _value} -> goal
      _absent when default == nil -> goal
      _absent -> Map.put(goal, name, default)
    end
  end

  @doc "Coerces the goal of a command, and checks that it has all arguments that are required."
  @spec complete(map() | keyword(), Command.t()) :: {:ok, map()} | {:error, Exception.t()}
  def complete(goal, %Command{} = command) do
    goal = coerce(goal, command.arguments)

    case Enum.find(command.arguments, &(&1.required and not is_map_key(goal, &1.name))) do
      nil ->
        {:ok, goal}

      argument ->
        reason = "required, put it into the goal"

        {:error, %Invalid.Command{command: command.name, argument: argument.name, reason: reason}}
    end
  end

  defp parse(:integer, text), do: parsed(Integer.parse(text), text)
  defp parse(:float, text), do: parsed(Float.parse(text), text)
  defp parse(:boolean, "true"), do: true
  defp parse(:boolean, "false"), do: false
  defp parse({:in, values}, text), do: Enum.find(values, text, &(written(&1) == text))

  defp parse(:atom, text) do
    String.to_existing_atom(text)
  rescue
    ArgumentError -> text
  end

  defp parse(_type, text), do: text

  defp parsed({value, ""}, _text), do: value
  defp parsed(_rest_or_error, text), do: text

  defp written(value) when is_atom(value) or is_number(value), do: to_string(value)
  defp written(value), do: value
end
