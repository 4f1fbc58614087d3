defmodule BB.Message.Actuator.Command.Position do
  @moduledoc """
  The command to move to a position.

  Use it for joints whose actuator controls the position, such as a servo:

      iex> {:ok, message} = BB.Message.Actuator.Command.Position.new(:shoulder, position: 1.57)
      iex> message.payload.position
      1.57
  """

  defstruct [:position, :velocity, :duration, :command_id]

  @type t :: %__MODULE__{
          position: float(),
          velocity: float() | nil,
          duration: pos_integer() | nil,
          command_id: reference() | nil
        }

  use BB.Message,
    schema: [
      position: [
        type: :float,
        required: true,
        doc: "The position in rad, or in m for a prismatic joint."
      ],
      velocity: [
        type: {:or, [:float, nil]},
        default: nil,
        doc: "The desired velocity, in rad/s or m/s. It is not guaranteed."
      ],
      duration: [
        type: {:or, [:pos_integer, nil]},
        default: nil,
        doc: "The desired duration, in milliseconds. It is not guaranteed."
      ],
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "An id that the messages about the resulting motion repeat."
      ]
    ]
end
