defmodule BB.Dsl.Color do
  @moduledoc """
  The `color` of a material. Its parts are numbers from 0 to 1.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:red, :green, :blue, alpha: 1]

  @type t :: %__MODULE__{red: number(), green: number(), blue: number(), alpha: number()}
end
