if match?({:error, _}, :code.lib_dir(:spark)) do
  defmodule Spark.Error.DslError do
    @moduledoc """
    Builds a `BB.Dsl.Error` under the name of the library Spark, where that is absent.

        raise Spark.Error.DslError, module: MyRobot, path: [:topology], message: "no link"

    It has no struct of its own, because no declaration raises one: rescue `BB.Dsl.Error`.
    """

    @doc "Returns the `BB.Dsl.Error` with these fields."
    @spec exception(keyword()) :: BB.Dsl.Error.t()
    defdelegate exception(fields), to: BB.Dsl.Error

    @doc "Returns the text of the error."
    @spec message(BB.Dsl.Error.t()) :: String.t()
    defdelegate message(error), to: BB.Dsl.Error
  end
end
