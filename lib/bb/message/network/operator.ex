defmodule BB.Message.Network.Operator do
  @moduledoc "A sign of life of whoever operates the robot. Published on `[:operator]`, several times a second."

  defstruct name: nil

  @type t :: %__MODULE__{name: String.t() | nil}

  use BB.Message,
    schema: [name: [type: {:or, [:string, nil]}, default: nil, doc: "Who it is, for a person."]]
end
