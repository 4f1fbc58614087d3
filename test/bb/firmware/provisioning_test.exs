defmodule BB.Firmware.ProvisioningTest do
  use ExUnit.Case, async: true

  import ExUnit.CaptureLog

  alias BB.Firmware.Board.Memory
  alias BB.Firmware.Network.None
  alias BB.Firmware.Provisioning
  alias BB.Test.Network

  doctest Provisioning

  defmodule Stubborn do
    def name(_handle, _name), do: raise("no mDNS here")
    def join(:short, _wifi), do: {:error, :password_too_short}
    def join(:raise, wifi), do: raise("no good: #{inspect(wifi)}")
  end

  defp provision(told, network) do
    {:ok, memory} = Memory.start_link(provisioned: told)
    assert Provisioning.start_link(board: {Memory, memory}, network: network) == :ignore
  end

  test "the card's name and Wi-Fi are given to the network" do
    {:ok, network} = Network.start_link(:disconnected)

    provision(
      %{"name" => "ada", "wifi_ssid" => "lab", "wifi_country" => "SE"},
      {Network, network}
    )

    assert_receive {Network, {:name, "ada"}}
    assert_receive {Network, {:join, %{ssid: "lab", passphrase: nil, country: "SE"}}}
  end

  test "a card that was told nothing changes nothing" do
    {:ok, network} = Network.start_link(:disconnected)
    provision(%{}, {Network, network})
    refute_received {Network, _}
  end

  test "what cannot be done is logged without the passphrase, and the start goes on" do
    told = %{"name" => "ada", "wifi_ssid" => "lab", "wifi_passphrase" => "secret"}

    for {handle, reason} <- [short: :password_too_short, raise: :refused] do
      log = capture_log(fn -> provision(told, {Stubborn, handle}) end)
      assert log =~ ~s(could not set the name "ada": "no mDNS here")
      assert log =~ ~s(could not set up the Wi-Fi "lab": #{inspect(reason)})
      refute log =~ "secret"
    end
  end

  test "without a board and a network of its own nothing is done" do
    assert Provisioning.start_link([]) == :ignore
    provision(%{"name" => "ada", "wifi_ssid" => "lab"}, {None, []})
  end
end
