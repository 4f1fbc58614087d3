defmodule BB.Dsl.Estimator.Input do
  @moduledoc """
  An `input` of an estimator.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:name, :path, driver?: false]

  @type t :: %__MODULE__{name: atom(), path: [atom()], driver?: boolean()}
end
