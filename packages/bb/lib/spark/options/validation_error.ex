if match?({:error, _}, :code.lib_dir(:spark)) do
  defmodule Spark.Options.ValidationError do
    @moduledoc """
    The error of `Spark.Options`, where the library Spark is absent: a
    `BB.Options.ValidationError` under the name that drivers match.

        {:error, %Spark.Options.ValidationError{key: :bus}} =
          Spark.Options.validate([bus: 1], bus: [type: :string])
    """

    @type t :: %__MODULE__{
            message: String.t(),
            key: atom() | [atom()],
            value: term(),
            keys_path: [atom()]
          }

    defexception [:message, :key, :value, keys_path: []]

    @impl Exception
    def message(%__MODULE__{} = error), do: error |> to_own() |> Exception.message()

    @doc "Converts an error of `BB.Options`."
    @spec of(BB.Options.ValidationError.t()) :: t()
    def of(%BB.Options.ValidationError{} = error), do: struct!(__MODULE__, fields(error))

    defp to_own(error), do: struct!(BB.Options.ValidationError, fields(error))

    defp fields(error), do: Map.take(error, [:message, :key, :value, :keys_path])
  end
end
