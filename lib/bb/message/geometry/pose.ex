defmodule BB.Message.Geometry.Pose do
  @moduledoc """
  The position and orientation of a body.

  Use it for a pose without covariance; with one, it is a `BB.Message.Estimator.Pose`.

      iex> pose = BB.Math.Transform.from_translation(BB.Math.Vec3.new(1, 2, 0))
      iex> {:ok, message} = BB.Message.Geometry.Pose.new(:map, pose)
      iex> BB.Message.Geometry.Pose.position(message.payload).y
      2.0
  """

  alias BB.Math.{Quaternion, Transform, Vec3}

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

  @doc """
  Creates a message from the position and the orientation. Returns `{:ok, message}`.

      iex> alias BB.Math.{Quaternion, Vec3}
      iex> alias BB.Message.Geometry.Pose
      iex> {:ok, message} = Pose.new(:map, Vec3.new(1, 2, 0), Quaternion.identity())
      iex> Pose.position(message.payload) == Vec3.new(1, 2, 0)
      true
  """
  @spec new(atom(), Vec3.t(), Quaternion.t()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, %Vec3{} = position, %Quaternion{} = orientation),
    do: new(frame_id, Transform.new(orientation, position))

  @doc "Creates a message from the transform, or from attributes. Returns `{:ok, message}`."
  @spec new(atom(), Transform.t() | BB.Message.attrs()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, %Transform{} = transform),
    do: BB.Message.new(__MODULE__, frame_id, transform: transform)

  def new(frame_id, attrs), do: BB.Message.new(__MODULE__, frame_id, attrs)

  @doc "Returns the position of a pose."
  @spec position(t()) :: Vec3.t()
  def position(%__MODULE__{transform: transform}),
    do: Transform.apply_point(transform, Vec3.zero())

  @doc "Returns the orientation of a pose."
  @spec orientation(t()) :: Quaternion.t()
  def orientation(%__MODULE__{transform: transform}), do: Transform.rotation(transform)

  @doc "Returns the transform of a pose."
  @spec to_transform(t()) :: Transform.t()
  def to_transform(%__MODULE__{transform: transform}), do: transform
end
