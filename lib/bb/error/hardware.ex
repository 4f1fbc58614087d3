defmodule BB.Error.Hardware do
  @moduledoc """
  The namespace of errors of buses and devices, see `BB.Error`.

  Use it for an error of your own: name the module `BB.Error.Hardware.…`.
  """

  @moduledoc no_example: "a namespace without functions"
end
