defmodule BB.Dsl.Inertial do
  @moduledoc """
  The `inertial` of a link: its mass, the centre of the mass, and its inertia.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:mass, :origin, :inertia]

  @type t :: %__MODULE__{
          mass: BB.Unit.t() | BB.Parameter.Reference.t(),
          origin: BB.Dsl.Origin.t() | nil,
          inertia: BB.Dsl.Inertia.t() | nil
        }
end
