defmodule BB.Message.Geometry.Accel do
  @moduledoc """
  The linear and angular acceleration of a body.

  Use it for measured or estimated accelerations:

      iex> alias BB.Math.Vec3
      iex> linear = Vec3.new(0.2, 0, 0)
      iex> {:ok, message} = BB.Message.Geometry.Accel.new(:base_link, linear, Vec3.zero())
      iex> message.payload.linear.x
      0.2
  """

  alias BB.Math.Vec3

  defstruct [:linear, :angular]

  @type t :: %__MODULE__{linear: Vec3.t(), angular: Vec3.t()}

  use BB.Message,
    schema: [
      linear: [type: {:struct, Vec3}, required: true, doc: "The linear acceleration in m/s²."],
      angular: [type: {:struct, Vec3}, required: true, doc: "The angular acceleration in rad/s²."]
    ]

  @doc "Creates a message from the two vectors. Returns `{:ok, message}`."
  @spec new(atom(), Vec3.t(), Vec3.t()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, linear, angular), do: new(frame_id, linear: linear, angular: angular)
end
