defmodule BB.Options.Schema do
  @moduledoc false
  # Checks options against a schema, level by level, and schemas against the schema of schemas.

  alias BB.Options.{Type, ValidationError}

  @doc "Returns the schema of schemas."
  def of_schemas do
    [
      *: [
        type: :keyword_list,
        keys: [
          type: [
            type: {:custom, Type, :check, []},
            default: :any,
            required: false,
            doc: "The type of the value, one of the types below."
          ],
          required: [
            type: :boolean,
            default: false,
            doc: "Whether the option must be given."
          ],
          default: [
            type: :any,
            doc: "The value of an option that is not given. It must be of the type, too."
          ],
          doc: [
            type: {:or, [:string, {:literal, false}]},
            doc: "The text for `docs/1`; `false` hides the option there."
          ],
          type_doc: [
            type: {:or, [:string, {:literal, false}]},
            doc: "The type as `docs/1` shows it, in place of its usual form."
          ],
          keys: [
            type: {:custom, __MODULE__, :check_nested, []},
            doc: "The schema of a nested `:keyword_list`, `:non_empty_keyword_list` or `:map`."
          ],
          subsection: [
            type: {:or, [:string, nil]},
            doc: "The title under which `docs/1` lists the option, after those without one."
          ],
          deprecated: [
            type: :string,
            doc: "The remedy, for the warning that a use of the option prints."
          ],
          private?: [type: :boolean, doc: "`true` hides the option from `docs/1`."],
          type_spec: [type: :any, doc: false],
          hide: [type: :any, doc: false],
          as: [type: :any, doc: false],
          snippet: [type: :any, doc: false],
          links: [type: :any, doc: false]
        ]
      ]
    ]
  end

  @doc "Checks a schema. Returns it with the defaults of its own keys filled in, or an error."
  def check(schema) do
    with {:ok, schema} <- validate(schema, of_schemas()) do
      conflict = Enum.find(schema, fn {_, spec} -> spec[:keys] && not nests?(spec[:type]) end)
      if conflict, do: {:error, keys_error(conflict)}, else: {:ok, schema}
    end
  end

  @doc "Checks the value of `keys:`, which is a schema too."
  def check_nested(keys) do
    case check(keys) do
      {:ok, keys} -> {:ok, keys}
      {:error, error} -> {:error, Exception.message(error)}
    end
  end

  @doc "Checks options against a checked schema."
  def validate(options, schema) when is_map(options) and not is_struct(options) do
    with {:ok, list} <- validate(Enum.sort(options), schema), do: {:ok, Map.new(list)}
  end

  def validate(options, schema) do
    if Keyword.keyword?(options) do
      schema = expand_star(schema, options)

      with :ok <- check_unknown(options, schema) do
        validate_each(schema, options, Keyword.keys(options))
      end
    else
      {:error, invalid_options_error(options)}
    end
  end

  @doc "Checks the options inside the option `key`, which its errors name."
  def validate_nested(options, schema, key) do
    with {:error, error} <- validate(options, schema) do
      {:error, %{error | keys_path: [key | error.keys_path]}}
    end
  end

  defp expand_star(schema, options) do
    case schema[:*] do
      nil -> schema
      spec -> schema ++ for {key, _} <- options, do: {key, spec}
    end
  end

  defp check_unknown(options, schema) do
    valid = Keyword.keys(schema)

    case Enum.uniq(Keyword.keys(options)) -- valid do
      [] ->
        :ok

      unknown ->
        {:error,
         %ValidationError{
           key: unknown,
           message: "unknown options #{inspect(unknown)}, valid options are: #{inspect(valid)}"
         }}
    end
  end

  defp validate_each([], options, _given), do: {:ok, options}

  defp validate_each([{key, spec} | rest], options, given) do
    case validate_one(key, spec, options, given) do
      {:ok, options} -> validate_each(rest, options, given)
      error -> error
    end
  end

  defp validate_one(key, spec, options, given) do
    with {:ok, value} <- fetch_value(options, key, spec, given),
         {:ok, value} <- cast(key, spec, value) do
      {:ok, put_value(options, key, value)}
    else
      :absent -> {:ok, options}
      error -> error
    end
  end

  defp fetch_value(options, key, spec, given) do
    cond do
      Keyword.has_key?(options, key) -> fetch_given(options, key, spec)
      spec[:required] -> {:error, missing_error(key, given)}
      true -> with :error <- Keyword.fetch(spec, :default), do: :absent
    end
  end

  defp fetch_given(options, key, spec) do
    if remedy = spec[:deprecated],
      do: IO.warn("option #{inspect(key)} is deprecated; #{remedy}")

    Keyword.fetch(options, key)
  end

  defp cast(key, spec, value) do
    case {Type.cast(spec[:type], value, key), spec[:keys]} do
      {{:ok, value}, nil} ->
        {:ok, value}

      {{:ok, value}, keys} ->
        validate_nested(value, keys, key)

      {{:error, message}, _} ->
        {:error, %ValidationError{key: key, value: value, message: message}}
    end
  end

  # If a key occurs several times, its first value counts.
  defp put_value(options, key, value) do
    if Keyword.has_key?(options, key),
      do: Keyword.replace(options, key, value),
      else: [{key, value} | options]
  end

  defp nests?(type), do: type in [:keyword_list, :non_empty_keyword_list, :map]

  defp missing_error(key, given) do
    %ValidationError{
      key: key,
      message: "required #{inspect(key)} option not found, received options: #{inspect(given)}"
    }
  end

  defp invalid_options_error(value) do
    %ValidationError{
      value: value,
      message: "invalid options: expected keyword list, got: #{inspect(value)}"
    }
  end

  defp keys_error({key, spec}) do
    %ValidationError{
      key: key,
      value: spec,
      message:
        "invalid value for :keys option: expected the type of #{inspect(key)} to be " <>
          ":keyword_list, :non_empty_keyword_list or :map, got: #{inspect(spec[:type])}"
    }
  end
end
