defmodule BB.Error.Hardware.Timeout do
  @moduledoc """
  A device did not answer in time.

      iex> error = %BB.Error.Hardware.Timeout{
      ...>   device: :servo,
      ...>   operation: :ping,
      ...>   timeout_ms: 50
      ...> }
      iex> Exception.message(error)
      "device servo did not answer ping within 50 ms"
  """

  use BB.Error, class: :hardware, fields: [:device, :operation, :timeout_ms]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "device #{text(e.device)} did not answer #{text(e.operation)} within #{text(e.timeout_ms)} ms"
  end
end
