defmodule BB.Error.Category do
  @moduledoc """
  The namespace of errors of categories of commands, see `BB.Error`.

  Use it for an error of your own: name the module `BB.Error.Category.…`.
  """

  @moduledoc no_example: "a namespace without functions"
end
