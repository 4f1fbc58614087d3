defmodule BB.Message.Actuator.Command.Hold do
  @moduledoc "Stay where you are, and withstand what pushes."

  defstruct [:command_id]

  @type t :: %__MODULE__{command_id: reference() | nil}

  use BB.Message,
    schema: [
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "Comes back in the messages about the motion that it causes."
      ]
    ]
end
