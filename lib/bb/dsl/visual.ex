defmodule BB.Dsl.Visual do
  @moduledoc """
  The `visual` of a link: what it looks like.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:geometry, :material, :origin]

  @type t :: %__MODULE__{
          geometry: BB.Dsl.Info.geometry() | nil,
          material: BB.Dsl.Material.t() | nil,
          origin: BB.Dsl.Origin.t() | nil
        }
end
