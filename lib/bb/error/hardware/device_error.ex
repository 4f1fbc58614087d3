defmodule BB.Error.Hardware.DeviceError do
  @moduledoc """
  A device reported an error of its own.

      iex> error = %BB.Error.Hardware.DeviceError{
      ...>   device: :gripper,
      ...>   error_code: 0x20,
      ...>   description: "overload"
      ...> }
      iex> Exception.message(error)
      "device gripper reported error 32: overload"
  """

  use BB.Error, class: :hardware, fields: [:device, :error_code, :description]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e),
    do: "device #{text(e.device)} reported error #{text(e.error_code)}: #{text(e.description)}"
end
