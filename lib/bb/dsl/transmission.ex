defmodule BB.Dsl.Transmission do
  @moduledoc """
  A `transmission` of a robot's declaration, between a joint and a motor or an encoder.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:offset, reduction: 1.0, reversed?: false]

  @type t :: %__MODULE__{
          offset: BB.Unit.t() | BB.Parameter.Reference.t() | nil,
          reduction: number() | BB.Parameter.Reference.t(),
          reversed?: boolean() | BB.Parameter.Reference.t()
        }
end
