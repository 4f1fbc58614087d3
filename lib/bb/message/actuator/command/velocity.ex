defmodule BB.Message.Actuator.Command.Velocity do
  @moduledoc "Move at a velocity, until the next command or the end of the time given."

  defstruct [:velocity, :duration, :command_id]

  @type t :: %__MODULE__{
          velocity: float(),
          duration: pos_integer() | nil,
          command_id: reference() | nil
        }

  use BB.Message,
    schema: [
      velocity: [type: :float, required: true, doc: "In rad/s, or m/s of a prismatic joint."],
      duration: [
        type: {:or, [:pos_integer, nil]},
        default: nil,
        doc: "For how long, in milliseconds; `nil` is until told otherwise."
      ],
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "Comes back in the messages about the motion that it causes."
      ]
    ]
end
