defmodule BB.Error.Estimator do
  @moduledoc """
  The namespace of errors of estimators and their inputs, see `BB.Error`.

  Use it for an error of your own: name the module `BB.Error.Estimator.…`.
  """

  @moduledoc no_example: "a namespace without functions"
end
