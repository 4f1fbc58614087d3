defmodule BB.Error.Safety.EmergencyStop do
  @moduledoc """
  An emergency stop was triggered.

      iex> Exception.message(%BB.Error.Safety.EmergencyStop{source: :button, reason: "pressed"})
      "emergency stop by button: pressed"
  """

  use BB.Error, class: :safety, fields: [:source, :reason]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :critical
  end

  @impl Exception
  def message(%__MODULE__{} = e), do: "emergency stop by #{text(e.source)}: #{text(e.reason)}"
end
