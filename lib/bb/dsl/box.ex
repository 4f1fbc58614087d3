defmodule BB.Dsl.Box do
  @moduledoc """
  A `box`, with the lengths of its sides.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:x, :y, :z]

  @type t :: %__MODULE__{x: BB.Unit.t(), y: BB.Unit.t(), z: BB.Unit.t()}
end
