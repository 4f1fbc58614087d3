defmodule BB.Message.Actuator.Command.Hold do
  @moduledoc """
  The command to hold the present position against external forces.

  Use it to keep a joint where it is:

      iex> {:ok, message} = BB.Message.Actuator.Command.Hold.new(:shoulder, [])
      iex> message.payload.command_id
      nil
  """

  defstruct [:command_id]

  @type t :: %__MODULE__{command_id: reference() | nil}

  use BB.Message,
    schema: [
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "An id that the messages about the resulting motion repeat."
      ]
    ]
end
