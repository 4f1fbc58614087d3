defmodule BB.Dsl.Limit do
  @moduledoc "The words inside `limit`, which says what a joint may do at most."
  use BB.Dsl.Vocabulary, fields: [:lower, :upper, :effort, :velocity]
end
