defmodule BB.Dsl.Settings do
  @moduledoc "The words inside `settings`."
  use BB.Dsl.Vocabulary, fields: [:name]
end
