defmodule BB.Message.Network.Connection do
  @moduledoc """
  The state of the board's network connection, published on `[:sensor, :network]`.

      iex> {:ok, message} = BB.Message.Network.Connection.new(:network, state: :lan)
      iex> message.payload.state
      :lan

  The states are:

    * `:disconnected` - the board has no network
    * `:lan` - the board reaches its local network, which is enough for a robot and its operator
    * `:internet` - the board reaches the Internet
    * `:unknown` - the state is unknown, because the network is not the robot's own
  """

  @states [:disconnected, :lan, :internet, :unknown]

  defstruct [:state]

  @type state :: :disconnected | :lan | :internet | :unknown
  @type t :: %__MODULE__{state: state()}

  use BB.Message,
    schema: [state: [type: {:in, @states}, required: true, doc: "One of the states above."]]
end
