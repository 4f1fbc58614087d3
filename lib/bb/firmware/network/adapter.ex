defmodule BB.Firmware.Network.Adapter do
  @moduledoc """
  Where the state of the network comes from: `{module, handle}`, a module with the callbacks below and what it is called with.

    * `BB.Firmware.Network.VintageNet` - a board's own network
    * `BB.Firmware.Network.None` - one that is not the robot's: the host

  Which one it is says `config :ganglion, :network`.
  """

  alias BB.Message.Network.Connection

  @type t :: {module(), handle :: term()}
  @type wifi :: %{
          ssid: String.t(),
          passphrase: String.t() | nil,
          country: String.t() | nil
        }

  @doc "Sends the calling process a message at each change from now on."
  @callback subscribe(handle :: term()) :: :ok

  @doc "The state as it is now."
  @callback state(handle :: term()) :: Connection.state()

  @doc "The state that such a message tells, `:error` when it is about something else."
  @callback change(handle :: term(), message :: term()) :: {:ok, Connection.state()} | :error

  @doc "Gives the board that name on its network."
  @callback name(handle :: term(), String.t()) :: :ok | {:error, term()}

  @doc "Joins that Wi-Fi, unless a person has set one up on the board itself. `nil` for none given."
  @callback join(handle :: term(), wifi()) :: :ok | {:error, term()}

  @doc "The source that the configuration names."
  @spec configured() :: t()
  def configured, do: Application.get_env(:ganglion, :network, {BB.Firmware.Network.None, []})

  @doc """
  Subscribes, and only then asks for the state, so that no change goes by. Raises or exits when the
  source is not there.
  """
  @spec subscribe(t()) :: Connection.state()
  def subscribe({module, handle}) do
    :ok = module.subscribe(handle)
    module.state(handle)
  end

  @doc """
  See `c:state/1`. `:unknown` when the source cannot be asked.

      iex> BB.Firmware.Network.Adapter.state({NoNetwork, []})
      :unknown
  """
  @spec state(t()) :: Connection.state()
  def state({module, handle}) do
    module.state(handle)
  catch
    _kind, _reason -> :unknown
  end

  @doc "See `c:change/2`. `:error` also when the source cannot tell."
  @spec change(t(), term()) :: {:ok, Connection.state()} | :error
  def change({module, handle}, message) do
    module.change(handle, message)
  catch
    _kind, _reason -> :error
  end

  @doc "See `c:name/2`. What goes wrong is an error."
  @spec name(t(), String.t()) :: :ok | {:error, term()}
  def name({module, handle}, name), do: try_to(fn -> module.name(handle, name) end)

  @doc "See `c:join/2`. What goes wrong is an error."
  @spec join(t(), wifi()) :: :ok | {:error, term()}
  def join({module, handle}, wifi), do: try_to(fn -> module.join(handle, wifi) end)

  defp try_to(fun) do
    fun.()
  rescue
    error -> {:error, Exception.message(error)}
  catch
    kind, reason -> {:error, {kind, reason}}
  end

  @doc """
  Whether a state reaches at least as far as another.

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
