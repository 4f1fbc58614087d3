defmodule BB.Error.Safety do
  @moduledoc """
  The namespace of critical errors, see `BB.Error`.

  Use it for an error of your own: name the module `BB.Error.Safety.…`.
  """

  @moduledoc no_example: "a namespace without functions"
end
