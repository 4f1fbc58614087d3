defmodule BB.Error.Invalid.Bridge do
  @moduledoc """
  The namespace of errors of bridges and their remote parameters, see `BB.Error`.

  Use it for an error of your own: name the module `BB.Error.Invalid.Bridge.…`.
  """

  @moduledoc no_example: "a namespace without functions"
end
