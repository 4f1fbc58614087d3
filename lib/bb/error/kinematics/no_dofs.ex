defmodule BB.Error.Kinematics.NoDofs do
  @moduledoc """
  No joint on the way to a link can move.

      iex> Exception.message(%BB.Error.Kinematics.NoDofs{target_link: :tool, chain_length: 2})
      "none of the 2 joints on the way to link :tool can move"
  """

  use BB.Error, class: :kinematics, fields: [:target_link, :chain_length]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "none of the #{text(e.chain_length)} joints on the way to link " <>
      "#{inspect(e.target_link)} can move"
  end
end
