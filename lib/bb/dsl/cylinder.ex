defmodule BB.Dsl.Cylinder do
  @moduledoc """
  A `cylinder` along the z axis.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:radius, :height]

  @type t :: %__MODULE__{radius: BB.Unit.t(), height: BB.Unit.t()}
end
