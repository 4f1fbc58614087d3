defmodule BB.Parameter.Startup do
  @moduledoc """
  Chooses the values with which a robot starts: the values of `start_link(params: …)` override
  persisted values, which override defaults. Pure. `BB.Supervisor` and `BB.Parameter.Owner` use
  it.
  """
  @moduledoc no_example: "internal: BB.Parameter explains the origin of values"

  alias BB.Options.ValidationError
  alias BB.Parameter.{Changed, Check, Definition}

  @type values :: %{BB.Parameter.path() => term()}

  @doc """
  Returns the values of `params:`, a keyword list nested as the parameters, by path; or the error
  of the first wrong value.
  """
  @spec given([Definition.t()], keyword()) :: {:ok, values()} | {:error, ValidationError.t()}
  def given(definitions, params) do
    definitions = Map.new(definitions, &{&1.path, &1})

    with {:error, error} <- cast_group(params, [], definitions, %{}),
         do: {:error, %{error | keys_path: [:params | error.keys_path]}}
  end

  @doc """
  Returns `{:ok, value, origin}` for a definition, or `:none` for a parameter without a value, and
  the error of the persisted value or `nil`.
  """
  @spec value(Definition.t(), persisted :: values(), given :: values()) ::
          {{:ok, term(), Changed.source()} | :none, ValidationError.t() | Exception.t() | nil}
  def value(%Definition{path: path} = definition, persisted, given) do
    {start, error} = persisted(definition, Map.fetch(persisted, path))

    case given do
      %{^path => value} -> {{:ok, value, :startup}, error}
      _ -> {start, error}
    end
  end

  defp persisted(definition, :error), do: {default(definition), nil}

  defp persisted(definition, {:ok, value}) do
    case safe_cast(definition, value) do
      {:ok, value} -> {{:ok, value, :persisted}, nil}
      {:error, error} -> {default(definition), error}
    end
  end

  defp default(%{default: nil}), do: :none
  defp default(%{default: default}), do: {:ok, default, :init}

  # A store may return any term, such as a struct of another version.
  defp safe_cast(definition, value) do
    Check.cast(definition, value)
  rescue
    error -> {:error, error}
  end

  defp cast_group([], _path, _definitions, values), do: {:ok, values}

  defp cast_group([{key, value} | rest], above, definitions, values) do
    with {:ok, values} <- cast_entry(value, above ++ [key], definitions, values),
         do: cast_group(rest, above, definitions, values)
  end

  defp cast_entry(value, path, definitions, values) do
    case definitions do
      %{^path => definition} ->
        with {:ok, value} <- Check.cast(definition, value),
             do: {:ok, Map.put(values, path, value)}

      _ ->
        cast_nested(value, path, definitions, values)
    end
  end

  defp cast_nested(value, path, definitions, values) do
    cond do
      names_below(path, definitions) == [] -> {:error, unknown(path, definitions)}
      Keyword.keyword?(value) -> cast_group(value, path, definitions, values)
      true -> {:error, no_group(path, value)}
    end
  end

  defp names_below(path, definitions) do
    for {other, _definition} <- definitions,
        List.starts_with?(other, path),
        name = Enum.at(other, length(path)),
        uniq: true,
        do: name
  end

  defp unknown(path, definitions) do
    {above, [key]} = Enum.split(path, -1)

    %ValidationError{
      key: [key],
      keys_path: above,
      message:
        "unknown options #{inspect([key])}, " <>
          "valid options are: #{inspect(Enum.sort(names_below(above, definitions)))}"
    }
  end

  defp no_group(path, value) do
    {above, [key]} = Enum.split(path, -1)

    %ValidationError{
      key: key,
      value: value,
      keys_path: above,
      message:
        "invalid value for #{inspect(key)} option: expected keyword list, got: #{inspect(value)}"
    }
  end
end
