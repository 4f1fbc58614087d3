defmodule BB.Dsl.Param do
  @moduledoc """
  A `param` of a robot's declaration.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:name, :type, :default, :min, :max, :doc]

  @type t :: %__MODULE__{
          name: atom(),
          type: BB.Parameter.Type.t(),
          default: term(),
          min: term(),
          max: term(),
          doc: String.t() | nil
        }
end
