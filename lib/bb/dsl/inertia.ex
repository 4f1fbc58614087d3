defmodule BB.Dsl.Inertia do
  @moduledoc """
  The `inertia` of a link about its centre of mass.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:ixx, :iyy, :izz, :ixy, :ixz, :iyz]

  @type t :: %__MODULE__{
          ixx: BB.Unit.t() | BB.Parameter.Reference.t(),
          iyy: BB.Unit.t() | BB.Parameter.Reference.t(),
          izz: BB.Unit.t() | BB.Parameter.Reference.t(),
          ixy: BB.Unit.t() | BB.Parameter.Reference.t(),
          ixz: BB.Unit.t() | BB.Parameter.Reference.t(),
          iyz: BB.Unit.t() | BB.Parameter.Reference.t()
        }
end
