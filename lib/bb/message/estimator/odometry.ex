defmodule BB.Message.Estimator.Odometry do
  @moduledoc """
  An estimate of a body's pose and motion, for example from its turning wheels.

  The pose is given in the message's frame, which is fixed in the world. The twist is given in the
  axes of the body, `child_frame_id`.

      iex> alias BB.Math.{Transform, Vec3}
      iex> twist = %BB.Message.Geometry.Twist{linear: Vec3.new(0.5, 0, 0), angular: Vec3.zero()}
      iex> {:ok, message} = BB.Message.Estimator.Odometry.new(:odom,
      ...>   pose: Transform.identity(), twist: twist, child_frame_id: :base_link)
      iex> message.payload.twist.linear.x
      0.5
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
        doc: "The transform from the body's coordinates to the frame's, in m."
      ],
      twist: [type: {:struct, Twist}, required: true, doc: "The velocities in m/s and rad/s."],
      child_frame_id: [
        type: :atom,
        default: nil,
        doc: "The frame of the body; `nil` is the robot."
      ],
      pose_covariance: [
        type: {:or, [{:struct, Covariance6}, nil]},
        default: nil,
        doc: "The covariance of x, y, z and the rotations about them, in m² and rad², if known."
      ],
      twist_covariance: [
        type: {:or, [{:struct, Covariance6}, nil]},
        default: nil,
        doc:
          "The covariance of the velocities along and about x, y, z, in m²/s², rad²/s², if known."
      ]
    ]
end
