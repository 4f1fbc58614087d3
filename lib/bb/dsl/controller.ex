defmodule BB.Dsl.Controller do
  @moduledoc """
  A `controller` of a robot's declaration.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:name, :child_spec, simulation: :omit, required: false]

  @type t :: %__MODULE__{
          name: atom(),
          child_spec: module() | {module(), keyword()},
          simulation: :omit | :mock | :start,
          required: boolean()
        }
end
