defmodule BB.Message.Geometry.Pose do
  @moduledoc """
  The position and orientation of a body.

  Use it for a pose without covariance; with one, it is a `BB.Message.Estimator.Pose`.

      iex> pose = BB.Math.Transform.from_translation(BB.Math.Vec3.new(1, 2, 0))
      iex> {:ok, message} = BB.Message.Geometry.Pose.new(:map, pose)
      iex> BB.Math.Transform.translation(message.payload.transform).y
      2.0
  """

  alias BB.Math.Transform

  defstruct [:transform]

  @type t :: %__MODULE__{transform: Transform.t()}

  use BB.Message,
    schema: [
      transform: [
        type: {:struct, Transform},
        required: true,
        doc: "The transform from the body's coordinates to the frame's, in m."
      ]
    ]

  @doc "Creates a message from the transform, or from attributes. Returns `{:ok, message}`."
  @spec new(atom(), Transform.t() | BB.Message.attrs()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, %Transform{} = transform),
    do: BB.Message.new(__MODULE__, frame_id, transform: transform)

  def new(frame_id, attrs), do: BB.Message.new(__MODULE__, frame_id, attrs)
end
