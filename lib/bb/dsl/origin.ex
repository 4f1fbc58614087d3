defmodule BB.Dsl.Origin do
  @moduledoc "The words inside `origin`, the place of a joint in its parent link."
  use BB.Dsl.Vocabulary, fields: [:x, :y, :z, :roll, :pitch, :yaw]
end
