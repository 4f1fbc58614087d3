defmodule BB.Dsl.Dynamics do
  @moduledoc """
  The `dynamics` of a joint: what resists its movement.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:damping, :friction]

  @type t :: %__MODULE__{
          damping: BB.Unit.t() | number() | BB.Parameter.Reference.t() | nil,
          friction: BB.Unit.t() | number() | BB.Parameter.Reference.t() | nil
        }
end
