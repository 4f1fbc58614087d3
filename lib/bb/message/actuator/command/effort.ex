defmodule BB.Message.Actuator.Command.Effort do
  @moduledoc "Push with a torque or a force, until the next command or the end of the time given."

  defstruct [:effort, :duration, :command_id]

  @type t :: %__MODULE__{
          effort: float(),
          duration: pos_integer() | nil,
          command_id: reference() | nil
        }

  use BB.Message,
    schema: [
      effort: [type: :float, required: true, doc: "In N·m, or N of a prismatic joint."],
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
