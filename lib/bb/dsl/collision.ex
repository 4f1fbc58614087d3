defmodule BB.Dsl.Collision do
  @moduledoc """
  A `collision` of a link: a shape that stands for the link where collisions are computed.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:name, :geometry, :origin]

  @type t :: %__MODULE__{
          name: atom(),
          geometry: BB.Dsl.Info.geometry() | nil,
          origin: BB.Dsl.Origin.t() | nil
        }
end
