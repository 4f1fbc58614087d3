defmodule BB.Dsl.Axis do
  @moduledoc "The words inside `axis`, the direction in which a joint turns or slides."
  use BB.Dsl.Vocabulary, fields: [:x, :y, :z]
end
