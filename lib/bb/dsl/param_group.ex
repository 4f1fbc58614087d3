defmodule BB.Dsl.ParamGroup do
  @moduledoc """
  A `group` of parameters in a robot's declaration.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:name, :doc, params: [], groups: []]

  @type t :: %__MODULE__{
          name: atom(),
          doc: String.t() | nil,
          params: [BB.Dsl.Param.t()],
          groups: [t()]
        }
end
