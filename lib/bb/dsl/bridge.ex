defmodule BB.Dsl.Bridge do
  @moduledoc """
  A `bridge` of a robot's declaration, to the parameters of another device.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:name, :child_spec, simulation: :omit]

  @type t :: %__MODULE__{
          name: atom(),
          child_spec: module() | {module(), keyword()},
          simulation: :omit | :mock | :start
        }
end
