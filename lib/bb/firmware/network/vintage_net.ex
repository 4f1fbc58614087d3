defmodule BB.Firmware.Network.VintageNet do
  @moduledoc """
  The network adapter of a board with VintageNet. Its state is the best connection of all
  interfaces; mDNS publishes the name of the board.

      config :ganglion, network: {BB.Firmware.Network.VintageNet, []}
  """

  @behaviour BB.Firmware.Network.Adapter

  alias VintageNetWiFi.Cookbook

  # These modules exist on boards alone, where the compiler checks the calls.
  unless Code.ensure_loaded?(VintageNet),
    do: @compile({:no_warn_undefined, [VintageNet, Cookbook, MdnsLite]})

  @property ["connection"]
  @wifi "wlan0"

  @impl BB.Firmware.Network.Adapter
  def subscribe(_handle), do: VintageNet.subscribe(@property)

  @impl BB.Firmware.Network.Adapter
  def state(_handle), do: state_of(VintageNet.get(@property, :disconnected))

  @impl BB.Firmware.Network.Adapter
  def change(_handle, {VintageNet, @property, _old, new, _meta}), do: {:ok, state_of(new)}
  def change(_handle, _message), do: :error

  @impl BB.Firmware.Network.Adapter
  def name(_handle, name), do: MdnsLite.set_hosts([:hostname, name])

  # Not persisted, because a persisted Wi-Fi is one that a person has set up on the board.
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

  defp state_of(state) when state in [:disconnected, :lan, :internet], do: state
  defp state_of(_state), do: :disconnected
end
