defmodule BB.Error.Category.Full do
  @moduledoc """
  As many commands of a category run as its limit allows.

      iex> Exception.message(%BB.Error.Category.Full{category: :motion, limit: 1, current: 1})
      "category :motion is full: 1 of 1 commands are running"
  """

  use BB.Error, class: :state, fields: [:category, :limit, :current]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "category #{inspect(e.category)} is full: #{text(e.current)} of #{text(e.limit)} " <>
      "commands are running"
  end
end
