defmodule BB.Message.Geometry.Twist2D do
  @moduledoc "How something moves in the plane."

  defstruct [:vx, :vy, :omega]

  @type t :: %__MODULE__{vx: float(), vy: float(), omega: float()}

  use BB.Message,
    schema: [
      vx: [type: :float, required: true, doc: "In m/s."],
      vy: [type: :float, required: true, doc: "In m/s."],
      omega: [type: :float, required: true, doc: "Counter-clockwise, in rad/s."]
    ]

  @doc "A message of the three floats, `{:ok, message}`."
  @spec new(atom(), float(), float(), float()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, vx, vy, omega), do: new(frame_id, vx: vx, vy: vy, omega: omega)
end
