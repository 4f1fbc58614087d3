defmodule BB.Message.Firmware.RoundTrip do
  @moduledoc """
  The message with which the firmware guard tests the robot's bus: it publishes one on
  `[:firmware, :guard]` and waits until it receives it.

      iex> {:ok, message} = BB.Message.Firmware.RoundTrip.new(:guard, token: 7)
      iex> message.payload.token
      7
  """

  defstruct [:token]

  @type t :: %__MODULE__{token: integer()}

  use BB.Message,
    schema: [token: [type: :integer, required: true, doc: "The number of the attempt."]]
end
