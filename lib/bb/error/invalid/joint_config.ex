defmodule BB.Error.Invalid.JointConfig do
  @moduledoc """
  The configuration of a joint does not fit its actuator.

      iex> error = %BB.Error.Invalid.JointConfig{
      ...>   joint: :pan,
      ...>   field: :lower,
      ...>   value: nil,
      ...>   expected: "a limit"
      ...> }
      iex> Exception.message(error)
      "joint :pan, field :lower: expected a limit, got: nil"
      iex> error = %BB.Error.Invalid.JointConfig{
      ...>   joint: :pan,
      ...>   field: :axis,
      ...>   message: "the servo needs an axis"
      ...> }
      iex> Exception.message(error)
      "joint :pan, field :axis: the servo needs an axis"
  """

  use BB.Error, class: :invalid, fields: [:joint, :field, :value, :expected, :message]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{message: nil} = e),
    do: "#{place(e)}: expected #{text(e.expected)}, got: #{inspect(e.value)}"

  def message(%__MODULE__{} = e), do: "#{place(e)}: #{text(e.message)}"

  defp place(%{field: nil, joint: joint}), do: "joint #{inspect(joint)}"

  defp place(%{field: field, joint: joint}),
    do: "joint #{inspect(joint)}, field #{inspect(field)}"
end
