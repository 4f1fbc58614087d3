defmodule BB.Error.Invalid do
  @moduledoc """
  The namespace of errors of invalid commands, configurations and parameters, see `BB.Error`.

  Use it for an error of your own: name the module `BB.Error.Invalid.…`.
  """

  @moduledoc no_example: "a namespace without functions"
end
