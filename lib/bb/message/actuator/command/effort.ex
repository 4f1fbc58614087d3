defmodule BB.Message.Actuator.Command.Effort do
  @moduledoc """
  The command to apply a torque or a force, until the next command or for a given duration.

      iex> {:ok, message} = BB.Message.Actuator.Command.Effort.new(:gripper, effort: 0.4)
      iex> message.payload.effort
      0.4

  Use it for joints that push or hold against a load, such as a gripper.
  """

  defstruct [:effort, :duration, :command_id]

  @type t :: %__MODULE__{
          effort: float(),
          duration: pos_integer() | nil,
          command_id: reference() | nil
        }

  use BB.Message,
    schema: [
      effort: [
        type: :float,
        required: true,
        doc: "The torque in N·m, or the force in N for a prismatic joint."
      ],
      duration: [
        type: {:or, [:pos_integer, nil]},
        default: nil,
        doc: "The duration in milliseconds; `nil` lasts until the next command."
      ],
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "An id that the messages about the resulting motion repeat."
      ]
    ]
end
