defmodule BB.Message.Actuator.BeginMotion do
  @moduledoc """
  An actuator begins to move: from where, to where, and when it expects to arrive.

  Where nothing measures a joint, its position in between follows from this. With `acceleration` and `peak_velocity` the motion
  speeds up, goes on and slows down; without them how it moves is not known.
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
      initial_position: [type: :float, required: true, doc: "In rad, or m of a prismatic joint."],
      target_position: [type: :float, required: true, doc: "In rad or m."],
      expected_arrival: [
        type: :integer,
        required: true,
        doc: "Erlang monotonic time in milliseconds."
      ],
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "Of the command that it follows."
      ],
      command_type: [
        type: {:or, [{:in, @command_types}, nil]},
        default: nil,
        doc: "What kind of command that was."
      ],
      acceleration: [
        type: {:or, [:float, nil]},
        default: nil,
        doc: "Magnitude, in rad/s² or m/s²."
      ],
      peak_velocity: [
        type: {:or, [:float, nil]},
        default: nil,
        doc: "Magnitude, in rad/s or m/s."
      ]
    ]
end
