defmodule BB.Dsl.Limit do
  @moduledoc """
  The `limit` of a joint.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:lower, :upper, :effort, :velocity, :acceleration]

  @type t :: %__MODULE__{
          lower: BB.Unit.t() | BB.Parameter.Reference.t() | nil,
          upper: BB.Unit.t() | BB.Parameter.Reference.t() | nil,
          effort: BB.Unit.t() | BB.Parameter.Reference.t() | nil,
          velocity: BB.Unit.t() | BB.Parameter.Reference.t() | nil,
          acceleration: BB.Unit.t() | BB.Parameter.Reference.t() | nil
        }
end
