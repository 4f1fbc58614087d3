defmodule BB.Message.Geometry.Pose do
  @moduledoc "Where something is, and how it is turned."

  alias BB.Math.Transform

  defstruct [:transform]

  @type t :: %__MODULE__{transform: Transform.t()}

  use BB.Message,
    schema: [
      transform: [
        type: {:struct, Transform},
        required: true,
        doc: "From its own coordinates to the frame's, in m."
      ]
    ]

  @doc "A message of the `transform` itself, or of attributes: `{:ok, message}`."
  @spec new(atom(), Transform.t() | BB.Message.attrs()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, %Transform{} = transform),
    do: BB.Message.new(__MODULE__, frame_id, transform: transform)

  def new(frame_id, attrs), do: BB.Message.new(__MODULE__, frame_id, attrs)
end
