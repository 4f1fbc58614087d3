defmodule BB.Firmware.Network.VintageNet do
  @moduledoc "The network of a board, as VintageNet sees it: the best connection of all its interfaces. Its name is told by mDNS."

  @behaviour BB.Firmware.Network.Adapter

  alias VintageNetWiFi.Cookbook

  # They are there on boards alone, and there the compiler shall check what is called.
  unless Code.ensure_loaded?(VintageNet),
    do: @compile({:no_warn_undefined, [VintageNet, Cookbook, MdnsLite]})

  @property ["connection"]
  @wifi "wlan0"

  @impl BB.Firmware.Network.Adapter
  def subscribe(_handle), do: VintageNet.subscribe(@property)

  @impl BB.Firmware.Network.Adapter
  def state(_handle), do: known(VintageNet.get(@property, :disconnected))

  @impl BB.Firmware.Network.Adapter
  def change(_handle, {VintageNet, @property, _old, new, _meta}), do: {:ok, known(new)}
  def change(_handle, _message), do: :error

  @impl BB.Firmware.Network.Adapter
  def name(_handle, name), do: MdnsLite.set_hosts([:hostname, name])

  # Not persisted: what a person sets up on the board is, and goes before the card.
  @impl BB.Firmware.Network.Adapter
  def join(_handle, wifi) do
    with false <- set_up?(VintageNet.get_configuration(@wifi)),
         {:ok, config} <- config(wifi) do
      VintageNet.configure(@wifi, in_country(config, wifi.country), persist: false)
    else
      true -> :ok
      {:error, reason} -> {:error, reason}
    end
  end

  defp set_up?(%{vintage_net_wifi: %{networks: [_ | _]}}), do: true
  defp set_up?(_config), do: false

  defp config(%{passphrase: nil} = wifi), do: Cookbook.open_wifi(wifi.ssid)
  defp config(wifi), do: Cookbook.wpa_psk(wifi.ssid, wifi.passphrase)

  defp in_country(config, nil), do: config

  defp in_country(config, country),
    do: put_in(config, [:vintage_net_wifi, :regulatory_domain], country)

  defp known(state) when state in [:disconnected, :lan, :internet], do: state
  defp known(_state), do: :disconnected
end
