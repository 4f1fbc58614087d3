defmodule BB.Firmware.Network.Source do
  @moduledoc """
  Where the state of the network comes from: `{module, handle}`, a module with the callbacks below and what it is called with.

    * `BB.Firmware.Network.VintageNet` - a board's own network
    * `BB.Firmware.Network.None` - one that is not the robot's: the host

  Which one it is says `config :ganglion, :network`.
  """

  alias BB.Message.Network.Connection

  @type t :: {module(), handle :: term()}

  @doc "Sends the calling process a message at each change from now on."
  @callback subscribe(handle :: term()) :: :ok

  @doc "The state as it is now."
  @callback state(handle :: term()) :: Connection.state()

  @doc "The state that such a message tells, `:error` when it is about something else."
  @callback change(handle :: term(), message :: term()) :: {:ok, Connection.state()} | :error

  @doc "The source that the configuration names."
  @spec configured() :: t()
  def configured, do: Application.get_env(:ganglion, :network, {BB.Firmware.Network.None, []})

  @doc "Subscribes, and only then asks for the state, so that no change goes by."
  @spec subscribe(t()) :: Connection.state()
  def subscribe({module, handle}) do
    :ok = module.subscribe(handle)
    module.state(handle)
  end

  @doc """
  See `c:state/1`. `:unknown` when the source cannot be asked.

      iex> BB.Firmware.Network.Source.state({NoNetwork, []})
      :unknown
  """
  @spec state(t()) :: Connection.state()
  def state({module, handle}) do
    module.state(handle)
  rescue
    _error -> :unknown
  catch
    :exit, _reason -> :unknown
  end

  @doc "See `c:change/2`."
  @spec change(t(), term()) :: {:ok, Connection.state()} | :error
  def change({module, handle}, message), do: module.change(handle, message)

  @doc """
  Whether a state reaches at least as far as another.

      iex> BB.Firmware.Network.Source.reaches?(:internet, :lan)
      true
      iex> BB.Firmware.Network.Source.reaches?(:unknown, :lan)
      false
  """
  @spec reaches?(Connection.state(), Connection.state()) :: boolean()
  def reaches?(state, wanted), do: reach(state) >= reach(wanted)

  defp reach(:internet), do: 2
  defp reach(:lan), do: 1
  defp reach(_nowhere), do: 0
end
