defmodule BB.Parameter.Check do
  @moduledoc """
  Casts values of parameters while a robot runs. A type may call a function outside of this
  library, which then runs by `BB.Callback`: its failure is an error of the value.
  """
  @moduledoc no_example: "internal: BB.Parameter returns its errors"

  alias BB.Callback
  alias BB.Options.ValidationError
  alias BB.Parameter.{Definition, Type}

  @doc "Casts a value as `BB.Parameter.Definition.cast/2` does, in bounded time."
  @spec cast(Definition.t(), term()) :: {:ok, term()} | {:error, ValidationError.t()}
  def cast(%Definition{} = definition, value) do
    if Type.foreign?(definition.type),
      do: call(definition, value),
      else: Definition.cast(definition, value)
  end

  defp call(definition, value) do
    opts = [
      name: "the check of parameter #{inspect(definition.path)}",
      quiet: true,
      remember: false
    ]

    case Callback.call({Definition, :cast, [definition, value]}, opts) do
      {:ok, result} -> result
      {:error, failure} -> {:error, error(definition.path, value, failure)}
    end
  end

  defp error(path, value, failure) do
    {above, [key]} = Enum.split(path, -1)

    %ValidationError{
      key: key,
      value: value,
      keys_path: above,
      message:
        "invalid value for #{inspect(key)} option: the check of its type " <>
          Callback.format_failure(failure)
    }
  end
end
