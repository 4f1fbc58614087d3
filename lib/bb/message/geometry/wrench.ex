defmodule BB.Message.Geometry.Wrench do
  @moduledoc """
  The force and torque on a body.

  Use it for measured or commanded forces:

      iex> alias BB.Math.Vec3
      iex> force = Vec3.new(0, 0, -4.9)
      iex> {:ok, message} = BB.Message.Geometry.Wrench.new(:wrist, force, Vec3.zero())
      iex> message.payload.force.z
      -4.9
  """

  alias BB.Math.Vec3

  defstruct [:force, :torque]

  @type t :: %__MODULE__{force: Vec3.t(), torque: Vec3.t()}

  use BB.Message,
    schema: [
      force: [type: {:struct, Vec3}, required: true, doc: "The force in N."],
      torque: [type: {:struct, Vec3}, required: true, doc: "The torque in N·m."]
    ]

  @doc "Creates a message from the two vectors. Returns `{:ok, message}`."
  @spec new(atom(), Vec3.t(), Vec3.t()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, force, torque), do: new(frame_id, force: force, torque: torque)
end
