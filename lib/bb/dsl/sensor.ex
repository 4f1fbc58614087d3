defmodule BB.Dsl.Sensor do
  @moduledoc "The words inside the block of a sensor."

  use BB.Dsl.Vocabulary, fields: [:required, :retain, :max_silence]
  import BB.Dsl.Vocabulary, only: [entity: 5]

  @doc "What is between the sensor and its joint: `reduction`, `offset`, `reversed?` (`BB.Transmission`)."
  defmacro transmission(fields),
    do: entity(:transmission, [fields], 0, [BB.Dsl.Transmission], __CALLER__)
end
