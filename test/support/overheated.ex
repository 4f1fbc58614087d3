defmodule BB.Test.Overheated do
  @moduledoc "An error as a driver defines it."

  use BB.Error, class: :hardware, fields: [:device, celsius: 90]

  defimpl BB.Error.Severity do
    def severity(%{celsius: celsius}), do: if(celsius > 100, do: :critical, else: :warning)
  end

  def message(%{device: device, celsius: celsius}), do: "device #{device} is at #{celsius} °C"
end
