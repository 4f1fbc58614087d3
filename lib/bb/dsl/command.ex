defmodule BB.Dsl.Command do
  @moduledoc """
  A `command` of a robot's declaration: what the robot can be asked to do.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [
    :name,
    :handler,
    :category,
    timeout: :infinity,
    allowed_states: [:idle],
    cancel: [],
    arm: false,
    disarm: false,
    arguments: []
  ]

  @type t :: %__MODULE__{
          name: atom(),
          handler: module() | {module(), keyword()},
          category: atom(),
          timeout: timeout(),
          allowed_states: [atom()],
          cancel: [atom()],
          arm: boolean(),
          disarm: boolean(),
          arguments: [BB.Dsl.Command.Argument.t()]
        }
end
