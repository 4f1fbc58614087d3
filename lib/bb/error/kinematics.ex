defmodule BB.Error.Kinematics do
  @moduledoc """
  The namespace of errors of links, joints and poses, see `BB.Error`.

  Use it for an error of your own: name the module `BB.Error.Kinematics.…`.
  """

  @moduledoc no_example: "a namespace without functions"
end
