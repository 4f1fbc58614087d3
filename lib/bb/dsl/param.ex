defmodule BB.Dsl.Param do
  @moduledoc "The words inside `param`, which say what a parameter is."
  use BB.Dsl.Vocabulary, fields: [:type, :default, :min, :max, :doc]
end
