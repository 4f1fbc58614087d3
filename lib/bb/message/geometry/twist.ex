defmodule BB.Message.Geometry.Twist do
  @moduledoc "How something moves."

  alias BB.Math.Vec3

  defstruct [:linear, :angular]

  @type t :: %__MODULE__{linear: Vec3.t(), angular: Vec3.t()}

  use BB.Message,
    schema: [
      linear: [type: {:struct, Vec3}, required: true, doc: "In m/s."],
      angular: [type: {:struct, Vec3}, required: true, doc: "In rad/s."]
    ]

  @doc "A message of the two vectors, `{:ok, message}`."
  @spec new(atom(), Vec3.t(), Vec3.t()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, linear, angular), do: new(frame_id, linear: linear, angular: angular)
end
