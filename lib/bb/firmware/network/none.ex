defmodule BB.Firmware.Network.None do
  @moduledoc "No network of the robot's own: its state is `:unknown` and never changes."

  @behaviour BB.Firmware.Network.Adapter

  @impl BB.Firmware.Network.Adapter
  def subscribe(_handle), do: :ok

  @impl BB.Firmware.Network.Adapter
  def state(_handle), do: :unknown

  @impl BB.Firmware.Network.Adapter
  def change(_handle, _message), do: :error

  @impl BB.Firmware.Network.Adapter
  def name(_handle, _name), do: :ok

  @impl BB.Firmware.Network.Adapter
  def join(_handle, _wifi), do: :ok
end
