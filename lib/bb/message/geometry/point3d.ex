defmodule BB.Message.Geometry.Point3D do
  @moduledoc "Where something is."

  alias BB.Math.Vec3

  defstruct [:vec]

  @type t :: %__MODULE__{vec: Vec3.t()}

  use BB.Message,
    schema: [
      vec: [type: {:struct, Vec3}, required: true, doc: "In the frame's coordinates, in m."]
    ]

  @doc "A message of the `vec` itself, or of attributes: `{:ok, message}`."
  @spec new(atom(), Vec3.t() | BB.Message.attrs()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, %Vec3{} = vec), do: BB.Message.new(__MODULE__, frame_id, vec: vec)
  def new(frame_id, attrs), do: BB.Message.new(__MODULE__, frame_id, attrs)
end
