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
          registrant: {BB.Parameter.path(), module()} | nil
        }

  @fields [:type, :default, :min, :max, :doc]

  @doc """
  Makes a definition from the fields `type:`, `default:`, `min:`, `max:` and `doc:`. Returns
  `{:ok, definition}` or `{:error, reason}`.

      iex> BB.Parameter.Definition.new([:arm, :gain], type: :float, default: 2.0, max: 1.0)
      {:error, "parameter [:arm, :gain]: default: expected at most 1.0, got: 2.0"}
  """
  @spec new(BB.Parameter.path(), Enumerable.t()) :: {:ok, t()} | {:error, String.t()}
  def new(path, fields) do
    fields = Map.new(fields)

    with :ok <- check_fields(Map.keys(fields) -- @fields),
         :ok <- check_type(fields),
         :ok <- Type.check_bounds(fields.type, fields[:min], fields[:max]),
         {:ok, definition} <- with_default(struct!(%__MODULE__{path: path, type: nil}, fields)) do
      {:ok, definition}
    else
      {:error, reason} -> {:error, "parameter #{inspect(path)}: #{reason}"}
    end
  end

  @doc """
  Makes the definitions of a schema, `[name: [type: …, default: …]]`, below `path`. Raises
  `ArgumentError` for a wrong schema.
  """
  @spec of_schema!(BB.Parameter.path(), keyword(), {BB.Parameter.path(), module()}) :: [t()]
  def of_schema!(path, schema, registrant) do
    for {name, fields} <- schema do
      case new(path ++ [name], fields) do
        {:ok, definition} -> %{definition | registrant: registrant}
        {:error, reason} -> raise ArgumentError, reason
      end
    end
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

    with {:error, message} <-
           Type.cast(definition.type, definition.min, definition.max, value, key) do
      {:error, %ValidationError{key: key, value: value, message: message, keys_path: above}}
    end
  end

  @doc "Describes a definition and its value, as `BB.Parameter.list/2` returns them."
  @spec describe(t(), term()) :: map()
  def describe(%__MODULE__{} = definition, value),
    do: definition |> Map.take([:type, :min, :max, :doc, :default]) |> Map.put(:value, value)

  defp check_fields([]), do: :ok

  defp check_fields(unknown),
    do: {:error, "unknown fields #{inspect(unknown)}, valid fields are: #{inspect(@fields)}"}

  defp check_type(%{type: type}), do: Type.check(type)

  defp check_type(_fields),
    do: {:error, "the type is missing; add `type:`, such as `type: :float`"}

  defp with_default(%{default: nil} = definition), do: {:ok, definition}

  defp with_default(%{default: default} = definition) do
    case cast(definition, default) do
      {:ok, default} -> {:ok, %{definition | default: default}}
      {:error, error} -> {:error, "default: #{reason(error)}"}
    end
  end

  # The message begins with the name of an option, and a default is no option.
  defp reason(%{message: message, key: key}),
    do: String.replace_prefix(message, "invalid value for #{inspect(key)} option: ", "")
end
