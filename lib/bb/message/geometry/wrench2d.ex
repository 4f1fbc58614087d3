defmodule BB.Message.Geometry.Wrench2D do
  @moduledoc "What acts on something in the plane."

  defstruct [:fx, :fy, :tau]

  @type t :: %__MODULE__{fx: float(), fy: float(), tau: float()}

  use BB.Message,
    schema: [
      fx: [type: :float, required: true, doc: "In N."],
      fy: [type: :float, required: true, doc: "In N."],
      tau: [type: :float, required: true, doc: "Counter-clockwise, in N·m."]
    ]

  @doc "A message of the three floats, `{:ok, message}`."
  @spec new(atom(), float(), float(), float()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, fx, fy, tau), do: new(frame_id, fx: fx, fy: fy, tau: tau)
end
