defmodule BB.Dsl.Material do
  @moduledoc """
  The `material` of a visual.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:name, :color, :texture]

  @type t :: %__MODULE__{
          name: atom(),
          color: BB.Dsl.Color.t() | nil,
          texture: BB.Dsl.Texture.t() | nil
        }
end
