defmodule BB.Message.Actuator.Command.Velocity do
  @moduledoc """
  The command to move at a velocity, until the next command or for a given duration.

  Use it for joints that turn continuously, such as wheels:

      iex> {:ok, message} = BB.Message.Actuator.Command.Velocity.new(:wheel, velocity: 2.0)
      iex> message.payload.velocity
      2.0
  """

  defstruct [:velocity, :duration, :command_id]

  @type t :: %__MODULE__{
          velocity: float(),
          duration: pos_integer() | nil,
          command_id: reference() | nil
        }

  use BB.Message,
    schema: [
      velocity: [
        type: :float,
        required: true,
        doc: "The velocity in rad/s, or in m/s for a prismatic joint."
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
