defmodule BB.Parameter.Definition do
  @moduledoc """
  The definition of a parameter: its path, type, bounds, default and documentation. Pure.
  `BB.Robot` lists the definitions of a robot.

      iex> {:ok, gain} = BB.Parameter.Definition.new([:arm, :gain], type: :float, default: 1.0)
      iex> {gain.path, gain.type, gain.default}
      {[:arm, :gain], :float, 1.0}

  `:registrant` is `nil` for a parameter of the robot's declaration, and `{path, module}` for a
  parameter that `BB.Parameter.register/3` has added.
  """

  alias BB.Options
  alias BB.Options.ValidationError
  alias BB.Parameter.Type

  @enforce_keys [:path, :type]
  defstruct [:path, :type, :min, :max, :default, :doc, :registrant]

  @type t :: %__MODULE__{
          path: BB.Parameter.path(),
          type: Type.t(),
          min: Type.bound(),
          max: Type.bound(),
          default: term(),
          doc: String.t() | nil,
          registrant: {BB.Parameter.path() | [], module()} | nil
        }

  @fields [:type, :default, :min, :max, :doc]

  @doc """
  Makes a definition from the fields `type:`, `default:`, `min:`, `max:` and `doc:`. Returns
  `{:ok, definition}` or `{:error, reason}`.

      iex> BB.Parameter.Definition.new([:arm, :gain], type: :float, default: 2.0, max: 1.0)
      {:error,
       "parameter [:arm, :gain]: invalid `default`: " <>
         "expected value to be at most 1.0, got: 2.0"}

  A type with bounds of its own, such as a unit of `BB.Unit.Option`, becomes a plain type with
  `min` and `max`.
  """
  @spec new(BB.Parameter.path(), Enumerable.t()) :: {:ok, t()} | {:error, String.t()}
  def new(path, fields) do
    fields = Map.new(fields)

    with :ok <- check_fields(Map.keys(fields) -- @fields),
         {:ok, type} <- fetch_type(fields),
         fields = put_type(fields, Type.describe(type)),
         {:ok, _type} <- Type.option_type(fields.type, fields.min, fields.max),
         {:ok, definition} <- with_default(struct!(%__MODULE__{path: path, type: nil}, fields)) do
      {:ok, definition}
    else
      {:error, reason} -> {:error, "parameter #{inspect(path)}: #{reason}"}
    end
  end

  @doc """
  Makes the definitions of a schema below `path`: a `BB.Options`, or a keyword list whose
  options may also have `min:` and `max:`. Raises `ArgumentError` for a wrong schema.

      iex> schema = BB.Options.new!(gain: [type: :float, required: true, doc: "The gain."])
      iex> [gain] = BB.Parameter.Definition.of_schema!([:arm], schema, nil)
      iex> {gain.path, gain.type, gain.default}
      {[:arm, :gain], :float, nil}
  """
  @spec of_schema!(
          BB.Parameter.path() | [],
          Options.schema() | Options.t() | Options.spark(),
          {BB.Parameter.path() | [], module()} | nil
        ) :: [t()]
  def of_schema!(path, schema, registrant) do
    for {name, spec} <- entries!(schema) do
      case new(path ++ [name], fields_of_spec(spec)) do
        {:ok, definition} -> %{definition | registrant: registrant}
        {:error, reason} -> raise ArgumentError, reason
      end
    end
  end

  defp entries!(schema) do
    entries = if is_list(schema), do: schema, else: Options.new!(schema).schema

    unless Keyword.keyword?(entries) and not Keyword.has_key?(entries, :*) do
      raise ArgumentError,
            "expected a schema of BB.Options with a name for each parameter, " <>
              "got: #{inspect(entries)}"
    end

    entries
  end

  # The keys of a schema that say nothing about a parameter's values: a value may be absent.
  defp fields_of_spec(spec) do
    {keys, fields} = spec |> Keyword.put_new(:type, :any) |> Keyword.pop(:keys)
    fields = Keyword.drop(fields, Options.spec_keys() -- @fields)
    fields = if fields[:doc] == false, do: Keyword.delete(fields, :doc), else: fields
    if keys, do: Keyword.update!(fields, :type, &{&1, keys}), else: fields
  end

  @doc """
  Casts a value to the type of the definition: `{:ok, value}`, converted to its unit, or
  `{:error, error}`.

      iex> {:ok, gain} = BB.Parameter.Definition.new([:arm, :gain], type: :float)
      iex> {:error, error} = BB.Parameter.Definition.cast(gain, 1)
      iex> Exception.message(error)
      "invalid value for :gain option: expected float, got: 1 (in options [:arm])"
  """
  @spec cast(t(), term()) :: {:ok, term()} | {:error, ValidationError.t()}
  def cast(%__MODULE__{path: path} = definition, value) do
    {above, [key]} = Enum.split(path, -1)

    with {:error, error} <-
           Type.cast(definition.type, definition.min, definition.max, value, key),
         do: {:error, %{error | keys_path: above ++ error.keys_path}}
  end

  @doc "Describes a definition and its value, as `BB.Parameter.list/2` returns them."
  @spec describe(t(), term()) :: map()
  def describe(%__MODULE__{} = definition, value),
    do: definition |> Map.take([:type, :min, :max, :doc, :default]) |> Map.put(:value, value)

  defp check_fields([]), do: :ok

  defp check_fields(unknown),
    do: {:error, "unknown fields #{inspect(unknown)}, valid fields are: #{inspect(@fields)}"}

  defp fetch_type(%{type: type}), do: Type.validate(type)

  defp fetch_type(_fields),
    do: {:error, "the type is missing; add `type:`, such as `type: :float`"}

  defp put_type(fields, {type, min, max}) do
    fields
    |> Map.put(:type, type)
    |> Map.update(:min, min, &(&1 || min))
    |> Map.update(:max, max, &(&1 || max))
  end

  defp with_default(%{default: nil} = definition), do: {:ok, definition}

  defp with_default(%{default: default} = definition) do
    case cast(definition, default) do
      {:ok, default} -> {:ok, %{definition | default: default}}
      {:error, error} -> {:error, "invalid `default`: #{reason(error)}"}
    end
  rescue
    # A custom type. It runs here, because the compiler makes a module available to this process.
    error -> {:error, "invalid `default`: the check of its type raised #{format(error)}"}
  end

  defp format(error), do: "#{inspect(error.__struct__)}: #{Exception.message(error)}"

  # The message begins with the name of an option, and a default is no option.
  defp reason(%{message: message, key: key}),
    do: String.replace_prefix(message, "invalid value for #{inspect(key)} option: ", "")
end
