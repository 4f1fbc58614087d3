defmodule BB.Firmware.Network.None do
  @moduledoc "No network of the robot's own: its state is `:unknown` and never changes."

  @behaviour BB.Firmware.Network.Source

  @impl BB.Firmware.Network.Source
  def subscribe(_handle), do: :ok

  @impl BB.Firmware.Network.Source
  def state(_handle), do: :unknown

  @impl BB.Firmware.Network.Source
  def change(_handle, _message), do: :error

  @impl BB.Firmware.Network.Source
  def name(_handle, _name), do: :ok

  @impl BB.Firmware.Network.Source
  def join(_handle, _wifi), do: :ok
end
