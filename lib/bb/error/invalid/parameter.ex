defmodule BB.Error.Invalid.Parameter do
  @moduledoc """
  The value of a parameter is invalid.

      iex> error = %BB.Error.Invalid.Parameter{
      ...>   param_path: [:arm, :gain],
      ...>   value: -1.0,
      ...>   reason: "expected at least 0.0"
      ...> }
      iex> Exception.message(error)
      "parameter [:arm, :gain]: expected at least 0.0, got: -1.0"
  """

  use BB.Error, class: :invalid, fields: [:param_path, :value, :reason]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e),
    do: "parameter #{inspect(e.param_path)}: #{text(e.reason)}, got: #{inspect(e.value)}"
end
