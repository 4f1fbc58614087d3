defmodule BB.Message.Network.Connection do
  @moduledoc """
  How far the board's network reaches. Published on `[:sensor, :network]`.

    * `:disconnected` - nowhere
    * `:lan` - to the neighbours: enough for a robot and its operator
    * `:internet` - everywhere
    * `:unknown` - nobody here knows: the network is not the robot's own
  """

  @states [:disconnected, :lan, :internet, :unknown]

  defstruct [:state]

  @type state :: :disconnected | :lan | :internet | :unknown
  @type t :: %__MODULE__{state: state()}

  use BB.Message,
    schema: [state: [type: {:in, @states}, required: true, doc: "One of the states above."]]
end
