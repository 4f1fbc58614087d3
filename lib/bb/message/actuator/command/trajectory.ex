defmodule BB.Message.Actuator.Command.Trajectory do
  @moduledoc """
  The command to follow waypoints, each with a position and a time.

  Use it for a motion that is planned in advance:

      iex> {:ok, message} = BB.Message.Actuator.Command.Trajectory.new(:shoulder, waypoints: [
      ...>   [position: 0.0, time_from_start: 0],
      ...>   [position: 1.57, velocity: 0.0, time_from_start: 1_000]
      ...> ])
      iex> message.payload.repeat
      1

  A waypoint may have a velocity and an acceleration. The driver decides what it does not have.
  """

  @waypoint BB.Options.new!(
              position: [
                type: :float,
                required: true,
                doc: "The position in rad, or in m for a prismatic joint."
              ],
              velocity: [type: {:or, [:float, nil]}, doc: "The velocity in rad/s or m/s."],
              acceleration: [
                type: {:or, [:float, nil]},
                doc: "The acceleration in rad/s² or m/s²."
              ],
              time_from_start: [
                type: :non_neg_integer,
                required: true,
                doc: "The time since the start, in milliseconds."
              ]
            )

  defstruct [:waypoints, :command_id, repeat: 1]

  @typedoc "A waypoint. `:position` and `:time_from_start` are required."
  @type waypoint :: [
          {:position, float()}
          | {:velocity, float() | nil}
          | {:acceleration, float() | nil}
          | {:time_from_start, non_neg_integer()}
        ]

  @type t :: %__MODULE__{
          waypoints: [waypoint()],
          repeat: pos_integer() | :forever,
          command_id: reference() | nil
        }

  use BB.Message,
    schema: [
      waypoints: [
        type: {:list, {:custom, __MODULE__, :check_waypoint, []}},
        required: true,
        type_doc: "list of `t:keyword/0`",
        doc:
          "The waypoints in the order of their times, each with:\n\n" <>
            BB.Options.docs(@waypoint)
      ],
      repeat: [
        type: {:or, [:pos_integer, {:literal, :forever}]},
        default: 1,
        doc: "The number of times to follow the waypoints."
      ],
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "An id that the messages about the resulting motion repeat."
      ]
    ]

  @doc false
  def check_waypoint(waypoint) do
    case BB.Options.validate(waypoint, @waypoint) do
      {:ok, waypoint} -> {:ok, waypoint}
      {:error, error} -> {:error, Exception.message(error)}
    end
  end
end
