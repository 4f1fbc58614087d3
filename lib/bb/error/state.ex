defmodule BB.Error.State do
  @moduledoc """
  The namespace of errors of a robot's state, see `BB.Error`.

  Use it for an error of your own: name the module `BB.Error.State.…`.
  """

  @moduledoc no_example: "a namespace without functions"
end
