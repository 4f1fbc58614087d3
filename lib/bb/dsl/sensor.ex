defmodule BB.Dsl.Sensor do
  @moduledoc "The words inside the block of a sensor."
  use BB.Dsl.Vocabulary, fields: [:required, :retain, :max_silence]
end
