defmodule BB.Firmware.Network.Adapter do
  @moduledoc """
  The adapter to the network of a board: a behaviour, and the functions that call it. Implement
  it for a board without VintageNet.

      config :ganglion, network: {BB.Firmware.Network.VintageNet, []}

  An adapter is `{module, handle}`: a module with the callbacks below, and their first argument.

    * `BB.Firmware.Network.VintageNet` - the network of a board with VintageNet
    * `BB.Firmware.Network.None` - no network of the robot's own: the default, for the host
  """

  alias BB.Message.Network.Connection

  @type t :: {module(), handle :: term()}
  @type wifi :: %{
          ssid: String.t(),
          passphrase: String.t() | nil,
          country: String.t() | nil
        }

  @doc "Subscribes the calling process to a message at each change."
  @callback subscribe(handle :: term()) :: :ok

  @doc "Returns the current state of the network."
  @callback state(handle :: term()) :: Connection.state()

  @doc "Returns the state in a message of the subscription, `:error` for any other message."
  @callback change(handle :: term(), message :: term()) :: {:ok, Connection.state()} | :error

  @doc "Sets the name of the board on its network."
  @callback name(handle :: term(), String.t()) :: :ok | {:error, term()}

  @doc "Joins a Wi-Fi, unless a person has set one up on the board itself."
  @callback join(handle :: term(), wifi()) :: :ok | {:error, term()}

  @doc "Returns the configured adapter."
  @spec configured() :: t()
  def configured, do: Application.get_env(:ganglion, :network, {BB.Firmware.Network.None, []})

  @doc """
  Subscribes the calling process, and then returns the state, so that no change is missed.
  Raises or exits when the network does not run.
  """
  @spec subscribe(t()) :: Connection.state()
  def subscribe({module, handle}) do
    :ok = module.subscribe(handle)
    module.state(handle)
  end

  @doc """
  Calls `c:state/1`. Returns `:unknown` after a failure.

      iex> BB.Firmware.Network.Adapter.state({NoNetwork, []})
      :unknown
  """
  @spec state(t()) :: Connection.state()
  def state({module, handle}) do
    module.state(handle)
  catch
    _kind, _reason -> :unknown
  end

  @doc "Calls `c:change/2`. Returns `:error` also after a failure."
  @spec change(t(), term()) :: {:ok, Connection.state()} | :error
  def change({module, handle}, message) do
    module.change(handle, message)
  catch
    _kind, _reason -> :error
  end

  @doc "Calls `c:name/2`. Returns `{:error, reason}` after a failure."
  @spec name(t(), String.t()) :: :ok | {:error, term()}
  def name({module, handle}, name), do: safely(fn -> module.name(handle, name) end)

  @doc "Calls `c:join/2`. Returns `{:error, reason}` after a failure."
  @spec join(t(), wifi()) :: :ok | {:error, term()}
  def join({module, handle}, wifi), do: safely(fn -> module.join(handle, wifi) end)

  defp safely(fun) do
    fun.()
  rescue
    error -> {:error, Exception.message(error)}
  catch
    kind, reason -> {:error, {kind, reason}}
  end

  @doc """
  Returns whether a state reaches at least as far as another.

      iex> BB.Firmware.Network.Adapter.reaches?(:internet, :lan)
      true
      iex> BB.Firmware.Network.Adapter.reaches?(:unknown, :lan)
      false
  """
  @spec reaches?(Connection.state(), Connection.state()) :: boolean()
  def reaches?(state, wanted), do: reach(state) >= reach(wanted)

  defp reach(:internet), do: 2
  defp reach(:lan), do: 1
  defp reach(_nowhere), do: 0
end
