defmodule BB.Message.Actuator.Command.Stop do
  @moduledoc "Stop moving. It does not make the actuator safe: that is disarming."

  defstruct [:command_id, mode: :immediate]

  @type t :: %__MODULE__{mode: :immediate | :decelerate, command_id: reference() | nil}

  use BB.Message,
    schema: [
      mode: [
        type: {:in, [:immediate, :decelerate]},
        default: :immediate,
        doc: "At once, or slowing down first."
      ],
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "Comes back in the messages about the motion that it causes."
      ]
    ]
end
