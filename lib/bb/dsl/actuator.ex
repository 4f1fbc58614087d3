defmodule BB.Dsl.Actuator do
  @moduledoc "The words inside an actuator."

  use BB.Dsl.Vocabulary, fields: [:required]
  import BB.Dsl.Vocabulary, only: [entity: 5]

  @doc "What is between the actuator and its joint: `reduction`, `offset`, `reversed?` (`BB.Transmission`)."
  defmacro transmission(fields),
    do: entity(:transmission, [fields], 0, [BB.Dsl.Transmission], __CALLER__)
end
