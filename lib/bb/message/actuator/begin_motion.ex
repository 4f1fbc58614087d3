defmodule BB.Message.Actuator.BeginMotion do
  @moduledoc """
  The message that an actuator begins to move, with start, target and expected time of arrival.

  An actuator publishes it when a command starts a motion. For a joint that no sensor measures,
  the position in between follows from it. With `acceleration` and `peak_velocity`, the motion
  accelerates, moves and decelerates; without them, its course is unknown.

      iex> {:ok, message} = BB.Message.Actuator.BeginMotion.new(:shoulder,
      ...>   initial_position: 0.0, target_position: 1.57, expected_arrival: 1_500)
      iex> message.payload.target_position
      1.57
  """

  @command_types [:position, :velocity, :effort, :trajectory]

  defstruct [
    :initial_position,
    :target_position,
    :expected_arrival,
    :command_id,
    :command_type,
    :acceleration,
    :peak_velocity
  ]

  @type command_type :: :position | :velocity | :effort | :trajectory

  @type t :: %__MODULE__{
          initial_position: float(),
          target_position: float(),
          expected_arrival: integer(),
          command_id: reference() | nil,
          command_type: command_type() | nil,
          acceleration: float() | nil,
          peak_velocity: float() | nil
        }

  use BB.Message,
    schema: [
      initial_position: [
        type: :float,
        required: true,
        doc: "The position at the start, in rad, or in m for a prismatic joint."
      ],
      target_position: [type: :float, required: true, doc: "The target, in rad or m."],
      expected_arrival: [
        type: :integer,
        required: true,
        doc: "The time of arrival, Erlang monotonic time in milliseconds."
      ],
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "The id of the command that causes the motion."
      ],
      command_type: [
        type: {:or, [{:in, @command_types}, nil]},
        default: nil,
        doc: "The type of that command."
      ],
      acceleration: [
        type: {:or, [:float, nil]},
        default: nil,
        doc: "The magnitude of the acceleration, in rad/s² or m/s²."
      ],
      peak_velocity: [
        type: {:or, [:float, nil]},
        default: nil,
        doc: "The magnitude of the velocity, in rad/s or m/s."
      ]
    ]
end
