defmodule BB.Message.Estimator.Pose do
  @moduledoc """
  An estimate of a body's position and orientation, with its covariance.

  Use it for the result of an estimator; a pose without covariance is a
  `BB.Message.Geometry.Pose`.

      iex> pose = BB.Math.Transform.from_translation(BB.Math.Vec3.new(1, 2, 0))
      iex> {:ok, message} = BB.Message.Estimator.Pose.new(:map, transform: pose)
      iex> message.payload.covariance
      nil
  """

  alias BB.Math.{Covariance6, Transform}

  defstruct [:transform, :covariance]

  @type t :: %__MODULE__{transform: Transform.t(), covariance: Covariance6.t() | nil}

  use BB.Message,
    schema: [
      transform: [
        type: {:struct, Transform},
        required: true,
        doc: "The transform from the body's coordinates to the frame's, in m."
      ],
      covariance: [
        type: {:or, [{:struct, Covariance6}, nil]},
        default: nil,
        doc: "The covariance of x, y, z and the rotations about them, in m² and rad², if known."
      ]
    ]
end
