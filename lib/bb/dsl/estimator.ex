defmodule BB.Dsl.Estimator do
  @moduledoc """
  An `estimator` of a robot's declaration.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [
    :name,
    :child_spec,
    :sync_tolerance,
    :latency_budget,
    :lost_after,
    :on_degraded,
    :on_lost,
    :on_recovered,
    inputs: [],
    outputs: [],
    recover_after: 1
  ]

  @type t :: %__MODULE__{
          name: atom(),
          child_spec: module() | {module(), keyword()},
          sync_tolerance: BB.Unit.t() | nil,
          latency_budget: BB.Unit.t() | nil,
          lost_after: BB.Unit.t() | nil,
          on_degraded: atom(),
          on_lost: atom(),
          on_recovered: atom(),
          inputs: [BB.Dsl.Estimator.Input.t()],
          outputs: [BB.Dsl.Estimator.Output.t()],
          recover_after: pos_integer()
        }
end
