defmodule BB.Dsl.Mesh do
  @moduledoc """
  A `mesh`: a shape in a file.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:filename, scale: 1]

  @type t :: %__MODULE__{filename: String.t(), scale: number()}
end
