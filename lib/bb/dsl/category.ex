defmodule BB.Dsl.Category do
  @moduledoc """
  A `category` of commands, of which so many may run at the same time.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:name, :doc, concurrency_limit: 1]

  @type t :: %__MODULE__{name: atom(), doc: String.t() | nil, concurrency_limit: pos_integer()}
end
