defmodule BB.Dsl.State do
  @moduledoc """
  A `state` in which an armed robot can be.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:name, :doc]

  @type t :: %__MODULE__{name: atom(), doc: String.t() | nil}

  @doc """
  Returns the names that no state may have, because they are states of the safety system.

  `:disarmed` may be declared, to document it.

      iex> BB.Dsl.State.reserved_names()
      [:armed, :disarming, :error]
  """
  @spec reserved_names() :: [atom()]
  def reserved_names, do: [:armed, :disarming, :error]
end
