defmodule BB.Dsl.Command.Argument do
  @moduledoc """
  An `argument` of a command.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:name, :type, :default, :doc, required: false]

  @type t :: %__MODULE__{
          name: atom(),
          type: BB.Options.type(),
          default: term(),
          doc: String.t() | nil,
          required: boolean()
        }
end
