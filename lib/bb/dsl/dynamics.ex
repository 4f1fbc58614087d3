defmodule BB.Dsl.Dynamics do
  @moduledoc "The words inside `dynamics`, which says how a joint resists."
  use BB.Dsl.Vocabulary, fields: [:damping, :friction]
end
