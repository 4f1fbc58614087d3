defmodule BB.Error.Invalid.CommandResult do
  @moduledoc """
  The `result/1` of a command returned a value that is no result.

      iex> Exception.message(%BB.Error.Invalid.CommandResult{command: MyRobot.Wave, value: :done})
      "command MyRobot.Wave: result/1 returned :done, expected {:ok, value}, " <>
        "{:ok, value, next_state: state} or {:error, reason}"
  """

  use BB.Error, class: :invalid, fields: [:command, :value]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "command #{inspect(e.command)}: result/1 returned #{inspect(e.value)}, expected " <>
      "{:ok, value}, {:ok, value, next_state: state} or {:error, reason}"
  end
end
