defmodule BB.Firmware.Network.None do
  @moduledoc """
  The network adapter of the host: its state is `:unknown` and never changes. It is the default of
  `BB.Firmware.Network.Adapter`.

      iex> BB.Firmware.Network.Adapter.state({BB.Firmware.Network.None, []})
      :unknown
  """

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
