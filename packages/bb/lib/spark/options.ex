# Spark's own module counts where Spark is a dependency. `BB.Options` takes the structs of both.
if match?({:error, _}, :code.lib_dir(:spark)) do
  defmodule Spark.Options do
    @moduledoc """
    `BB.Options` under the name that drivers use, where the library Spark is absent.

        schema = Spark.Options.new!(bus: [type: :string, required: true])
        {:ok, [bus: "i2c-1"]} = Spark.Options.validate([bus: "i2c-1"], schema)

    `BB.Options` lists the types.
    """

    alias Spark.Options.ValidationError

    @enforce_keys [:schema]
    defstruct [:schema]

    @type t :: %__MODULE__{schema: schema()}

    @type schema :: keyword()

    @doc "Checks a schema and wraps it. Raises `ArgumentError` for an invalid schema."
    @spec new!(schema() | t()) :: t()
    def new!(schema), do: %__MODULE__{schema: BB.Options.new!(schema).schema}

    @doc "Checks a schema. Returns `{:ok, schema}` or `{:error, validation_error}`."
    @spec new(schema() | t()) :: {:ok, t()} | {:error, ValidationError.t()}
    def new(schema) do
      case BB.Options.new(schema) do
        {:ok, %BB.Options{schema: schema}} -> {:ok, %__MODULE__{schema: schema}}
        {:error, error} -> {:error, ValidationError.of(error)}
      end
    end

    @doc "Checks options against a schema. Returns `{:ok, options}` or `{:error, error}`."
    @spec validate(keyword() | map(), schema() | t()) ::
            {:ok, keyword() | map()} | {:error, ValidationError.t()}
    def validate(options, schema) do
      with {:error, error} <- BB.Options.validate(options, schema),
           do: {:error, ValidationError.of(error)}
    end

    @doc "Checks options as `validate/2` does. Returns the options or raises the error."
    @spec validate!(keyword() | map(), schema() | t()) :: keyword() | map()
    def validate!(options, schema) do
      case validate(options, schema) do
        {:ok, options} -> options
        {:error, error} -> raise error
      end
    end

    @doc "Merges two schemas into a keyword list. An option of `right` replaces that of `left`."
    @spec merge(schema() | t(), schema() | t(), String.t() | nil) :: schema()
    defdelegate merge(left, right, section \\ nil), to: BB.Options

    @doc "Describes the options of a schema as a Markdown list."
    @spec docs(schema() | t(), keyword()) :: String.t()
    defdelegate docs(schema, opts \\ []), to: BB.Options
  end
end
