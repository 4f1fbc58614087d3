defmodule BB.Firmware.Provisioning do
  @moduledoc """
  What a card was told when it was burned: the robot's name on the network, and a Wi-Fi. `firmware/provisioning.conf` writes it beside the
  firmware, so that updates leave it and one image serves many robots.

  | name | what |
  |---|---|
  | `name` | the robot's, by mDNS `<name>.local` |
  | `wifi_ssid`, `wifi_passphrase` | a Wi-Fi to join; without a passphrase an open one |
  | `wifi_country` | two letters, for the channels that are allowed there |

  It is done once, when the application starts, and leaves no process. What cannot be done, or
  does not return in time, is logged without what was told, and the robot runs all the same. A
  Wi-Fi that a person sets up on the board itself goes before the card's.
  """

  require Logger

  alias BB.Firmware.{Attempt, Board}
  alias BB.Firmware.Network.Adapter

  @limit_ms 10_000

  @doc false
  def child_spec(opts),
    do: %{id: __MODULE__, start: {__MODULE__, :start_link, [opts]}, restart: :transient}

  @doc """
  Does it, and always returns `:ignore`. Options: `board:` and `network:`, without which they are
  the configured ones, and `limit_ms:` (#{@limit_ms}) for each step.
  """
  @spec start_link(keyword()) :: :ignore
  def start_link(opts) do
    network = opts[:network] || Adapter.configured()
    board = opts[:board] || Board.configured()
    once = [attempts: 1, limit_ms: opts[:limit_ms] || @limit_ms]

    with {:ok, told} <-
           Attempt.run("what the card was told", fn -> Board.provisioned(board) end, once) do
      for step <- steps(told), do: Attempt.run(what(step), fn -> take(step, network) end, once)
    end

    :ignore
  end

  # Without the passphrase.
  defp what({:name, name}), do: "the name #{inspect(name)}"
  defp what({:join, wifi}), do: "the Wi-Fi #{inspect(wifi.ssid)}"

  @doc """
  What follows from what the card was told.

      iex> BB.Firmware.Provisioning.steps(%{"name" => "ada", "wifi_ssid" => "lab", "wifi_passphrase" => "12345678"})
      [name: "ada", join: %{ssid: "lab", passphrase: "12345678", country: nil}]
      iex> BB.Firmware.Provisioning.steps(%{"wifi_passphrase" => "of no network"})
      []
  """
  @spec steps(%{String.t() => String.t()}) :: [name: String.t(), join: Adapter.wifi()]
  def steps(told) do
    wifi = for ssid <- List.wrap(told["wifi_ssid"]), do: {:join, wifi(ssid, told)}
    for(name <- List.wrap(told["name"]), do: {:name, name}) ++ wifi
  end

  defp wifi(ssid, told),
    do: %{ssid: ssid, passphrase: told["wifi_passphrase"], country: told["wifi_country"]}

  defp take({:name, name}, network),
    do: told(Adapter.name(network, name), "the name #{inspect(name)} was not taken")

  defp take({:join, wifi}, network),
    do:
      told(unnamed(Adapter.join(network, wifi)), "the Wi-Fi #{inspect(wifi.ssid)} was not set up")

  # Whatever is no plain word may have the passphrase in it.
  defp unnamed({:error, reason}) when not is_atom(reason), do: {:error, :refused}
  defp unnamed(result), do: result

  defp told(:ok, _what), do: :ok
  defp told({:error, reason}, what), do: Logger.error("#{what}: #{inspect(reason)}")
end
