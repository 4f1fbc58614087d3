defmodule BB.Firmware.Network.VintageNet do
  @moduledoc "The network of a board, as VintageNet sees it: the best connection of all its interfaces."

  @behaviour BB.Firmware.Network.Source

  # It is there on boards alone, and there the compiler shall check what is called.
  unless Code.ensure_loaded?(VintageNet), do: @compile({:no_warn_undefined, VintageNet})

  @property ["connection"]

  @impl BB.Firmware.Network.Source
  def subscribe(_handle), do: VintageNet.subscribe(@property)

  @impl BB.Firmware.Network.Source
  def state(_handle), do: known(VintageNet.get(@property, :disconnected))

  @impl BB.Firmware.Network.Source
  def change(_handle, {VintageNet, @property, _old, new, _meta}), do: {:ok, known(new)}
  def change(_handle, _message), do: :error

  defp known(state) when state in [:disconnected, :lan, :internet], do: state
  defp known(_state), do: :disconnected
end
