defmodule BB.Error.Invalid.Command do
  @moduledoc """
  An argument of a command is invalid.

      iex> error = %BB.Error.Invalid.Command{
      ...>   command: :move,
      ...>   argument: :speed,
      ...>   value: -1,
      ...>   reason: "expected a positive number"
      ...> }
      iex> Exception.message(error)
      "command :move, argument :speed: expected a positive number, got: -1"
  """

  use BB.Error, class: :invalid, fields: [:command, :argument, :value, :reason]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "command #{inspect(e.command)}, argument #{inspect(e.argument)}: " <>
      "#{text(e.reason)}, got: #{inspect(e.value)}"
  end
end
