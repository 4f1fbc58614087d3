defmodule BB.Message.Estimator.Odometry do
  @moduledoc """
  Where something is and how it moves, by an estimate such as one from turning wheels.

  The pose is in the message's frame, which is fixed in the world. The twist is in the axes of what moves, `child_frame_id`.
  """

  alias BB.Math.{Covariance6, Transform}
  alias BB.Message.Geometry.Twist

  defstruct [:pose, :twist, :child_frame_id, :pose_covariance, :twist_covariance]

  @type t :: %__MODULE__{
          pose: Transform.t(),
          twist: Twist.t(),
          child_frame_id: atom(),
          pose_covariance: Covariance6.t() | nil,
          twist_covariance: Covariance6.t() | nil
        }

  use BB.Message,
    schema: [
      pose: [
        type: {:struct, Transform},
        required: true,
        doc: "From the coordinates of what moves to the frame's, in m."
      ],
      twist: [type: {:struct, Twist}, required: true, doc: "In m/s and rad/s."],
      child_frame_id: [type: :atom, default: nil, doc: "What moves; `nil` is the robot."],
      pose_covariance: [
        type: {:or, [{:struct, Covariance6}, nil]},
        default: nil,
        doc: "Of x, y, z and the rotations about them, in m² and rad²; `nil` is not known."
      ],
      twist_covariance: [
        type: {:or, [{:struct, Covariance6}, nil]},
        default: nil,
        doc:
          "Of the velocities along and about x, y and z, in m²/s² and rad²/s²; `nil` is not known."
      ]
    ]
end
