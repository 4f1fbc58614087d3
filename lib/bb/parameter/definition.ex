defmodule BB.Parameter.Definition do
  @moduledoc """
  What a parameter is: its path, type, bounds, default and purpose. Pure.

  `:registrant` is `nil` for a parameter of the robot's declaration, and `{path, module}` for one that
  `BB.Parameter.register/3` brought.
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
  A definition of the fields `type:`, `default:`, `min:`, `max:` and `doc:`, or what is wrong with them.

      iex> BB.Parameter.Definition.new([:arm, :gain], type: :float, default: 2.0, max: 1.0)
      {:error, "parameter [:arm, :gain]: default: expected at most 1.0, got: 2.0"}
  """
  @spec new(BB.Parameter.path(), Enumerable.t()) :: {:ok, t()} | {:error, String.t()}
  def new(path, fields) do
    fields = Map.new(fields)

    with :ok <- known(Map.keys(fields) -- @fields),
         :ok <- typed(fields),
         :ok <- Type.check_bounds(fields.type, fields[:min], fields[:max]),
         {:ok, definition} <- with_default(struct!(%__MODULE__{path: path, type: nil}, fields)) do
      {:ok, definition}
    else
      {:error, reason} -> {:error, "parameter #{inspect(path)}: #{reason}"}
    end
  end

  @doc "The definitions of a schema, `[name: [type: …, default: …]]`, below `path`. Raises `ArgumentError` when it is wrong."
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
  A value as the definition wants it: `{:ok, value}`, converted to its unit, or `{:error, error}`.

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

  @doc "The definition and its value as `BB.Parameter.list/2` shows them."
  @spec describe(t(), term()) :: map()
  def describe(%__MODULE__{} = definition, value),
    do: definition |> Map.take([:type, :min, :max, :doc, :default]) |> Map.put(:value, value)

  defp known([]), do: :ok

  defp known(unknown),
    do: {:error, "it has no #{listed(unknown)}; it takes #{listed(@fields)}"}

  defp typed(%{type: type}), do: Type.check(type)

  defp typed(_fields),
    do: {:error, "it has no type; add `type:`, such as `type: :float`"}

  defp with_default(%{default: nil} = definition), do: {:ok, definition}

  defp with_default(%{default: default} = definition) do
    case cast(definition, default) do
      {:ok, default} -> {:ok, %{definition | default: default}}
      {:error, error} -> {:error, "default: #{reason(error)}"}
    end
  end

  # The sentence's beginning names an option, which a default is not.
  defp reason(%{message: message, key: key}),
    do: String.replace_prefix(message, "invalid value for #{inspect(key)} option: ", "")

  defp listed(words), do: Enum.map_join(words, ", ", &inspect/1)
end
