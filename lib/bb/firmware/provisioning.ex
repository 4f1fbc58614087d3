defmodule BB.Firmware.Provisioning do
  @moduledoc """
  Applies the settings on a board's card: the robot's name on the network, and a Wi-Fi.
  `firmware/provisioning.conf` writes them beside the firmware when a card is burned, so that
  updates keep them and one image serves many robots. `BB.Firmware.Supervisor` starts it.

      iex> BB.Firmware.Provisioning.steps(%{"name" => "ada"})
      [name: "ada"]

  | setting | meaning |
  |---|---|
  | `name` | the robot's mDNS name, `<name>.local` |
  | `wifi_ssid`, `wifi_passphrase` | a Wi-Fi to join; an open one without a passphrase |
  | `wifi_country` | two letters, for the channels that are allowed there |

  It runs once, when the application starts, and leaves no process. A step that fails or does not
  return in time is logged without the settings, and the robot runs all the same. A Wi-Fi that a
  person sets up on the board overrides the Wi-Fi of the card.
  """

  require Logger

  alias BB.Firmware.{Attempt, Board}
  alias BB.Firmware.Network.Adapter

  @limit_ms 10_000

  @doc false
  def child_spec(opts),
    do: %{id: __MODULE__, start: {__MODULE__, :start_link, [opts]}, restart: :transient}

  @doc """
  Applies the settings and returns `:ignore`.

  Options: `board:` and `network:` (default: the configured ones), and `limit_ms:`
  (#{@limit_ms}) for each step.
  """
  @spec start_link(keyword()) :: :ignore
  def start_link(opts) do
    network = opts[:network] || Adapter.configured()
    board = opts[:board] || Board.configured()
    once = [attempts: 1, limit_ms: opts[:limit_ms] || @limit_ms]

    with {:ok, settings} <-
           Attempt.run("read the card's settings", fn -> Board.provisioned(board) end, once) do
      for step <- steps(settings),
          do: Attempt.run(describe(step), fn -> take(step, network) end, once)
    end

    :ignore
  end

  # Without the passphrase.
  defp describe({:name, name}), do: "set the name #{inspect(name)}"
  defp describe({:join, wifi}), do: "set up the Wi-Fi #{inspect(wifi.ssid)}"

  @doc """
  Returns the steps for the settings of a card.

      iex> card = %{"wifi_ssid" => "lab", "wifi_passphrase" => "12345678"}
      iex> BB.Firmware.Provisioning.steps(card)
      [join: %{ssid: "lab", passphrase: "12345678", country: nil}]
      iex> BB.Firmware.Provisioning.steps(%{"wifi_passphrase" => "of no network"})
      []
  """
  @spec steps(%{String.t() => String.t()}) :: [name: String.t(), join: Adapter.wifi()]
  def steps(settings) do
    wifi = for ssid <- List.wrap(settings["wifi_ssid"]), do: {:join, wifi(ssid, settings)}
    for(name <- List.wrap(settings["name"]), do: {:name, name}) ++ wifi
  end

  defp wifi(ssid, settings),
    do: %{ssid: ssid, passphrase: settings["wifi_passphrase"], country: settings["wifi_country"]}

  defp take({:name, name} = step, network),
    do: log_error(Adapter.name(network, name), step)

  defp take({:join, wifi} = step, network),
    do: network |> Adapter.join(wifi) |> hide_reason() |> log_error(step)

  # A reason that is no atom may contain the passphrase.
  defp hide_reason({:error, reason}) when not is_atom(reason), do: {:error, :refused}
  defp hide_reason(result), do: result

  defp log_error(:ok, _step), do: :ok

  defp log_error({:error, reason}, step),
    do: Logger.error("could not #{describe(step)}: #{inspect(reason)}")
end
