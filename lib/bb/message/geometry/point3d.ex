defmodule BB.Message.Geometry.Point3D do
  @moduledoc """
  The position of a point.

  Use it for the position of something without an orientation:

      iex> {:ok, message} = BB.Message.Geometry.Point3D.new(:camera, BB.Math.Vec3.new(0, 0, 1.5))
      iex> BB.Message.Geometry.Point3D.z(message.payload)
      1.5
  """

  alias BB.Math.Vec3

  defstruct [:vec]

  @type t :: %__MODULE__{vec: Vec3.t()}

  use BB.Message,
    schema: [
      vec: [
        type: {:struct, Vec3},
        required: true,
        doc: "The position in the frame's coordinates, in m."
      ]
    ]

  @doc "Creates a message from the vector, or from attributes. Returns `{:ok, message}`."
  @spec new(atom(), Vec3.t() | BB.Message.attrs()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, %Vec3{} = vec), do: BB.Message.new(__MODULE__, frame_id, vec: vec)
  def new(frame_id, attrs), do: BB.Message.new(__MODULE__, frame_id, attrs)

  @doc "Returns the x coordinate of a point."
  @spec x(t()) :: float()
  def x(%__MODULE__{vec: vec}), do: vec.x

  @doc "Returns the y coordinate of a point."
  @spec y(t()) :: float()
  def y(%__MODULE__{vec: vec}), do: vec.y

  @doc "Returns the z coordinate of a point."
  @spec z(t()) :: float()
  def z(%__MODULE__{vec: vec}), do: vec.z

  @doc "Returns the position of a point as a vector."
  @spec to_vec3(t()) :: Vec3.t()
  def to_vec3(%__MODULE__{vec: vec}), do: vec
end
