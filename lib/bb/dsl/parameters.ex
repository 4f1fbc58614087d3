defmodule BB.Dsl.Parameters do
  @moduledoc "The words inside `parameters`."

  import BB.Dsl.Vocabulary, only: [entity: 5]

  @doc """
  Declares a parameter: `param :rate, type: {:unit, :hertz}, default: ~u(100 hertz), min: ~u(1 hertz)`.

  Fields, as keywords or in a block: `type` (`BB.Parameter.Type`), `default`, `min`, `max`, `doc`. Without a default its value is
  `nil` until it is set.
  """
  defmacro param(name, fields), do: entity(:param, [name, fields], 1, [BB.Dsl.Param], __CALLER__)

  defmacro param(name, fields, block),
    do: entity(:param, [name, fields, block], 1, [BB.Dsl.Param], __CALLER__)

  @doc "A group of parameters, and of groups: its name stands in their paths before theirs."
  defmacro group(name, block),
    do: entity(:group, [name, block], 1, [BB.Dsl.Parameters], __CALLER__)
end
