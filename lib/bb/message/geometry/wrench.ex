defmodule BB.Message.Geometry.Wrench do
  @moduledoc "What acts on something."

  alias BB.Math.Vec3

  defstruct [:force, :torque]

  @type t :: %__MODULE__{force: Vec3.t(), torque: Vec3.t()}

  use BB.Message,
    schema: [
      force: [type: {:struct, Vec3}, required: true, doc: "In N."],
      torque: [type: {:struct, Vec3}, required: true, doc: "In N·m."]
    ]

  @doc "A message of the two vectors, `{:ok, message}`."
  @spec new(atom(), Vec3.t(), Vec3.t()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, force, torque), do: new(frame_id, force: force, torque: torque)
end
