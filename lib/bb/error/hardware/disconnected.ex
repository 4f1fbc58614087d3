defmodule BB.Error.Hardware.Disconnected do
  @moduledoc """
  A device is no longer connected.

      iex> error = %BB.Error.Hardware.Disconnected{
      ...>   device: "/dev/ttyUSB0",
      ...>   reason: :enodev
      ...> }
      iex> Exception.message(error)
      "device /dev/ttyUSB0 disconnected: enodev"
  """

  use BB.Error, class: :hardware, fields: [:device, :reason]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e), do: "device #{text(e.device)} disconnected: #{text(e.reason)}"
end
