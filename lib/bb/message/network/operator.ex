defmodule BB.Message.Network.Operator do
  @moduledoc """
  The heartbeat of a robot's operator, published on `[:operator]` several times a second.

  The robot uses it to notice that its operator is gone:

      iex> {:ok, message} = BB.Message.Network.Operator.new(:remote, name: "Ada")
      iex> message.payload.name
      "Ada"
  """

  defstruct name: nil

  @type t :: %__MODULE__{name: String.t() | nil}

  use BB.Message,
    schema: [
      name: [
        type: {:or, [:string, nil]},
        default: nil,
        doc: "The name of the operator, to be shown."
      ]
    ]
end
