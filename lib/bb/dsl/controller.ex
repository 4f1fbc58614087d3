defmodule BB.Dsl.Controller do
  @moduledoc "The words inside a controller."
  use BB.Dsl.Vocabulary, fields: [:required]
end
