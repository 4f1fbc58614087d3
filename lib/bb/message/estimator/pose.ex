defmodule BB.Message.Estimator.Pose do
  @moduledoc "Where something is by an estimate, how it is turned, and how sure that is."

  alias BB.Math.{Covariance6, Transform}

  defstruct [:transform, :covariance]

  @type t :: %__MODULE__{transform: Transform.t(), covariance: Covariance6.t() | nil}

  use BB.Message,
    schema: [
      transform: [
        type: {:struct, Transform},
        required: true,
        doc: "From its own coordinates to the frame's, in m."
      ],
      covariance: [
        type: {:or, [{:struct, Covariance6}, nil]},
        default: nil,
        doc: "Of x, y, z and the rotations about them, in m² and rad²; `nil` is not known."
      ]
    ]
end
