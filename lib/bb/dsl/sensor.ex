defmodule BB.Dsl.Sensor do
  @moduledoc """
  A `sensor` of a robot's declaration.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [
    :name,
    :child_spec,
    :transmission,
    :max_silence,
    estimators: [],
    required: false,
    retain: false
  ]

  @type t :: %__MODULE__{
          name: atom(),
          child_spec: module() | {module(), keyword()},
          transmission: BB.Dsl.Transmission.t() | nil,
          max_silence: BB.Unit.t() | nil,
          estimators: [BB.Dsl.Estimator.t()],
          required: boolean(),
          retain: boolean()
        }
end
