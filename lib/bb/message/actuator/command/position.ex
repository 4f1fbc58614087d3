defmodule BB.Message.Actuator.Command.Position do
  @moduledoc "Go to a position."

  defstruct [:position, :velocity, :duration, :command_id]

  @type t :: %__MODULE__{
          position: float(),
          velocity: float() | nil,
          duration: pos_integer() | nil,
          command_id: reference() | nil
        }

  use BB.Message,
    schema: [
      position: [type: :float, required: true, doc: "In rad, or m of a prismatic joint."],
      velocity: [
        type: {:or, [:float, nil]},
        default: nil,
        doc: "How fast, in rad/s or m/s; a wish."
      ],
      duration: [
        type: {:or, [:pos_integer, nil]},
        default: nil,
        doc: "How long it may take, in milliseconds; a wish."
      ],
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "Comes back in the messages about the motion that it causes."
      ]
    ]
end
