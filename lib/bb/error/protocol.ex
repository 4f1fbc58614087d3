defmodule BB.Error.Protocol do
  @moduledoc """
  The namespace of errors of the protocols of devices, which drivers define, see `BB.Error`.

  Use it for an error of your own: name the module `BB.Error.Protocol.…`.
  """

  @moduledoc no_example: "a namespace without functions"
end
