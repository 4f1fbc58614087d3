defmodule BB.Options do
  alias BB.Options.{Docs, Schema, ValidationError}

  @moduledoc """
  Checks keyword lists of options against a schema, with errors that name the option and the
  value.

  Drivers, payloads and functions with options declare their schemas in this format, which is that
  of NimbleOptions:

      iex> schema = BB.Options.new!(
      ...>   bus: [type: :string, required: true, doc: "The name of the bus."],
      ...>   rate: [type: {:or, [:pos_integer, :float]}, default: 100]
      ...> )
      iex> BB.Options.validate([bus: "i2c-1"], schema)
      {:ok, [rate: 100, bus: "i2c-1"]}
      iex> {:error, error} = BB.Options.validate([bus: :one], schema)
      iex> Exception.message(error)
      "invalid value for :bus option: expected string, got: :one"

  ## The keys of an option

  #{Docs.generate(Schema.of_schemas()[:*][:keys], [])}

  The key `:*` in a schema describes all options without an entry of their own.

  A `%Spark.Options{}` is accepted wherever a schema is, so that a driver may declare its options
  with the library Spark.

  ## Types

    * `:any`, `:atom`, `:boolean`, `:integer`, `:non_neg_integer`, `:pos_integer`, `:number`,
      `:pid`, `:reference`, `nil`
    * `:float` - a float. Integers are refused, which shows mistakes of units such as `1` for
      `0.001`.
    * `:string` - a binary
    * `:module` - an atom other than `nil`, `true` and `false`
    * `:timeout` - a non-negative integer or `:infinity`
    * `:keyword_list`, `:non_empty_keyword_list`, `:map` - the key `keys:` of the option gives a
      schema for the content
    * `:mfa` - `{module, function, args}`
    * `:mod_arg` - `{module, argument}`
    * `{:behaviour, module}` - a module that can be loaded and declares this behaviour
    * `{:custom, module, function, args}` - checked by `module.function(value, ...args)`, which
      returns `{:ok, value}`, with the same or a changed value, or `{:error, message}`
    * `{:fun, arity}` - a function of this arity
    * `{:in, choices}` - a member of a list, a range or another enumerable
    * `{:list, type}` - a list with elements of this type
    * `{:literal, value}` - exactly this value
    * `{:map, key_type, value_type}` - a map with keys and values of these types
    * `{:or, types}` - a value of one of these types; the first that fits is used. Here and in
      `:list`, `{:keyword_list, schema}` is a type, too.
    * `{:struct, module}` - a struct of this module
    * `{:tuple, types}` - a tuple with one element for each type
    * `{:wrap_list, type}` - a list, or a single value, which becomes a list of one element; `nil`
      becomes `[]`

  The types of Spark that stand for one of these are accepted too: `:fun`, `:literal`, `:quoted`,
  `:regex`, `:struct`, `{:fun, argument_types}`, `{:fun, argument_types, type}`,
  `{:mfa_or_fun, arity}`, `{:one_of, choices}`, `{:spark_behaviour, module}` and
  `{:tagged_tuple, tag, type}`.
  """

  @enforce_keys [:schema]
  defstruct [:schema]

  @typedoc "A schema that `new!/1` has checked."
  @type t :: %__MODULE__{schema: schema()}

  @type schema :: keyword()

  @typedoc "A `%Spark.Options{}`, which is accepted wherever a schema is."
  @type spark :: struct()

  @doc """
  Checks a schema and wraps it, so that `validate/2` does not check it again.

  Raises `ArgumentError` for an invalid schema.
  """
  @spec new!(schema() | t() | spark()) :: t()
  def new!(schema) do
    case new(schema) do
      {:ok, schema} ->
        schema

      {:error, error} ->
        raise ArgumentError, "invalid BB.Options schema. Reason: #{Exception.message(error)}"
    end
  end

  @doc """
  Checks a schema as `new!/1` does. Returns `{:ok, schema}`, or `{:error, error}` with a
  `BB.Options.ValidationError`.

      iex> {:error, error} = BB.Options.new(rate: [required: 1])
      iex> Exception.message(error)
      "invalid value for :required option: expected boolean, got: 1 (in options [:rate])"
  """
  @spec new(schema() | t() | spark()) :: {:ok, t()} | {:error, ValidationError.t()}
  def new(%__MODULE__{} = schema), do: {:ok, schema}
  def new(%{__struct__: Spark.Options, schema: schema}), do: new(schema)

  def new(schema) do
    with {:ok, schema} <- Schema.check(schema), do: {:ok, %__MODULE__{schema: schema}}
  end

  @doc """
  Checks options against a schema.

  Returns `{:ok, options}` with defaults filled in, or `{:error, error}` with a
  `BB.Options.ValidationError`. If a key occurs twice, its first value counts. Maps are checked
  like keyword lists and returned as maps. Any other term is an error.
  """
  @spec validate(keyword() | map(), schema() | t() | spark()) ::
          {:ok, keyword() | map()} | {:error, ValidationError.t()}
  def validate(options, %__MODULE__{schema: schema}), do: Schema.validate(options, schema)
  def validate(options, schema), do: validate(options, new!(schema))

  @doc "Checks options as `validate/2` does. Returns the options or raises the error."
  @spec validate!(keyword() | map(), schema() | t() | spark()) :: keyword() | map()
  def validate!(options, schema) do
    case validate(options, schema) do
      {:ok, options} -> options
      {:error, error} -> raise error
    end
  end

  @doc """
  Merges two schemas into one keyword list. An option of `right` replaces the option of `left`
  with its name.

  `section` is the title under which `docs/2` lists the options of `right`.

      iex> common = [bus: [type: :string]]
      iex> BB.Options.merge(common, [rate: [type: :float]], "Timing")
      [bus: [type: :string], rate: [subsection: "Timing", type: :float]]
  """
  @spec merge(schema() | t() | spark(), schema() | t() | spark(), String.t() | nil) :: schema()
  def merge(left, right, section \\ nil)
  def merge(%{schema: left}, right, section), do: merge(left, right, section)
  def merge(left, %{schema: right}, section), do: merge(left, right, section)
  def merge(left, right, nil), do: Keyword.merge(left, right)

  def merge(left, right, section) do
    Keyword.merge(left, for({key, spec} <- right, do: {key, put_section(spec, section)}))
  end

  defp put_section(spec, section), do: Keyword.put(spec, :subsection, section)

  @doc """
  Returns the schema as a Markdown list, for a moduledoc.

      iex> BB.Options.docs(rate: [type: :pos_integer, default: 100, doc: "Samples per second."])
      "  * `:rate` (`t:pos_integer/0`) - Samples per second. The default value is `100`.\\n\\n"

  The option `nest_level: n` indents the list for a place inside another one.
  """
  @spec docs(schema() | t() | spark(), nest_level: non_neg_integer()) :: String.t()
  def docs(schema, opts \\ [])
  def docs(%{schema: schema}, opts), do: Docs.generate(schema, opts)
  def docs(schema, opts), do: Docs.generate(schema, opts)

  @doc false
  # The keys that the description of an option may have.
  @spec spec_keys() :: [atom()]
  def spec_keys, do: Keyword.keys(Schema.of_schemas()[:*][:keys])
end
