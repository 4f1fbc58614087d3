defmodule BB.Error.Hardware.BusError do
  @moduledoc """
  A transfer on a bus failed, such as one on I2C or SPI.

      iex> error = %BB.Error.Hardware.BusError{
      ...>   bus: "i2c-1",
      ...>   address: 0x40,
      ...>   operation: :write,
      ...>   reason: :nack
      ...> }
      iex> Exception.message(error)
      "write at 64 on bus i2c-1 failed: nack"
  """

  use BB.Error, class: :hardware, fields: [:bus, :address, :operation, :reason]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "#{text(e.operation)} at #{text(e.address)} on bus #{text(e.bus)} failed: #{text(e.reason)}"
  end
end
