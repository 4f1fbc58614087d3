defmodule BB.Options do
  alias BB.Options.{Docs, Schema, ValidationError}

  @moduledoc """
  Checks keyword lists of options against a schema, and says exactly what is wrong with them.

  Schemas have the format of NimbleOptions, so a driver's schema reads as in any Elixir library:

      iex> schema = BB.Options.new!(
      ...>   bus: [type: :string, required: true, doc: "The bus's name."],
      ...>   rate: [type: {:or, [:pos_integer, :float]}, default: 100]
      ...> )
      iex> BB.Options.validate([bus: "i2c-1"], schema)
      {:ok, [rate: 100, bus: "i2c-1"]}
      iex> {:error, error} = BB.Options.validate([bus: :one], schema)
      iex> Exception.message(error)
      "invalid value for :bus option: expected string, got: :one"

  ## The keys of an option

  #{Docs.generate(Schema.of_schemas()[:*][:keys], [])}

  The key `:*` in a schema describes each option that has no description of its own.

  ## Types

    * `:any`, `:atom`, `:boolean`, `:integer`, `:non_neg_integer`, `:pos_integer`, `:number`, `:pid`, `:reference`, `nil`
    * `:float` - a float; an integer is refused, so that a unit mistake such as `1` for `0.001` is seen early
    * `:string` - a binary
    * `:module` - an atom that can name a module: any but `nil`, `true` and `false`
    * `:timeout` - a non-negative integer or `:infinity`
    * `:keyword_list`, `:non_empty_keyword_list`, `:map` - with `keys:` in the option, what is in it is checked too
    * `:mfa` - `{module, function, args}`; `:mod_arg` - `{module, argument}`
    * `{:behaviour, module}` - a module that can be loaded and declares that behaviour
    * `{:custom, module, function, args}` - checked by `module.function(value, ...args)`, which returns `{:ok, value}`, with
      which it may change the value, or `{:error, message}`
    * `{:fun, arity}` - a function
    * `{:in, choices}` - a member of a list, a range or another enumerable
    * `{:list, type}` - a list of it
    * `{:literal, value}` - exactly that value
    * `{:map, key_type, value_type}` - a map
    * `{:or, types}` - the first of the types that fits; here and in `:list`, `{:keyword_list, schema}` is a type
    * `{:struct, module}` - a struct
    * `{:tuple, types}` - a tuple with an element for each type
    * `{:wrap_list, type}` - a list, or a single value, which becomes a list of one; `nil` becomes `[]`
  """

  @enforce_keys [:schema]
  defstruct [:schema]

  @typedoc "A schema that `new!/1` has checked."
  @type t :: %__MODULE__{schema: schema()}

  @type schema :: keyword()

  @doc """
  Checks a schema and wraps it, so that `validate/2` need not check it again.

  Raises `ArgumentError` for a schema that is wrong.
  """
  @spec new!(schema() | t()) :: t()
  def new!(%__MODULE__{} = schema), do: schema

  def new!(schema) do
    case Schema.check(schema) do
      {:ok, schema} ->
        %__MODULE__{schema: schema}

      {:error, error} ->
        raise ArgumentError, "invalid BB.Options schema. Reason: #{Exception.message(error)}"
    end
  end

  @doc """
  Checks `options` against a schema: `{:ok, options}` with defaults filled in, or `{:error, error}`.

  The error is a `BB.Options.ValidationError`. Of a key that is given twice the first value counts. Maps are checked like
  keyword lists, and come back as maps. Anything else is an error too.
  """
  @spec validate(keyword() | map(), schema() | t()) ::
          {:ok, keyword() | map()} | {:error, ValidationError.t()}
  def validate(options, %__MODULE__{schema: schema}), do: Schema.validate(options, schema)
  def validate(options, schema), do: validate(options, new!(schema))

  @doc "Like `validate/2`, but returns the options themselves or raises the error."
  @spec validate!(keyword() | map(), schema() | t()) :: keyword() | map()
  def validate!(options, schema) do
    case validate(options, schema) do
      {:ok, options} -> options
      {:error, error} -> raise error
    end
  end

  @doc """
  The schema as a Markdown list, for a moduledoc.

      iex> BB.Options.docs(rate: [type: :pos_integer, default: 100, doc: "Samples a second."])
      "  * `:rate` (`t:pos_integer/0`) - Samples a second. The default value is `100`.\\n\\n"

  With `nest_level: n` the list is indented for a place inside another.
  """
  @spec docs(schema() | t(), nest_level: non_neg_integer()) :: String.t()
  def docs(schema, opts \\ [])
  def docs(%__MODULE__{schema: schema}, opts), do: Docs.generate(schema, opts)
  def docs(schema, opts), do: Docs.generate(schema, opts)
end
