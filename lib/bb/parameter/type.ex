defmodule BB.Parameter.Type do
  @moduledoc """
  The types of parameters. Pure. Use them in the field `type` of `param`:

      param :rate, type: {:unit, :hertz}, default: ~u(100 hertz), min: ~u(1 hertz)

    * `:float`, `:integer`, `:boolean`, `:string`, `:atom` and all other types of `BB.Options`,
      such as `:pos_integer`, `{:in, choices}`, `{:list, type}`, `{:struct, module}` or
      `{:custom, module, function, args}`; a `:float` accepts no integer
    * `{:unit, unit}` - a `BB.Unit` that converts to `unit`; its value is stored in `unit`

  A unit may also stand inside another type: `{:or, [{:unit, :meter}, nil]}`.

  Numbers, units and lists of them can have bounds, `min:` and `max:`. The bounds of a unit are
  units.
  """

  alias BB.{Options, Unit}
  alias BB.Parameter.Bounds

  @nesting [:keyword_list, :non_empty_keyword_list, :map]

  # The modules whose `:custom` types belong to this library.
  @own [__MODULE__, BB.Unit.Option, BB.Options.SparkType]

  @typedoc "A type of `BB.Options`, or a unit."
  @type t :: {:unit, Unit.name()} | term()

  @type bound :: number() | Unit.t() | nil

  @doc """
  Checks that a term is a type. Returns `{:ok, type}` or `{:error, reason}`.

      iex> BB.Parameter.Type.validate({:list, {:unit, :meter}})
      {:ok, {:list, {:unit, :meter}}}
      iex> BB.Parameter.Type.validate({:unit, :metre})
      {:error, ~s(unknown unit "metre"; did you mean meter or ampere?)}
      iex> {:error, reason} = BB.Parameter.Type.validate(:flaot)
      iex> reason =~ "expected a type, got: :flaot; use :any, :atom, :boolean, "
      true
  """
  @spec validate(term()) :: {:ok, t()} | {:error, String.t()}
  def validate(type), do: with(:ok <- check(type), do: {:ok, type})

  @doc """
  Returns the type of `BB.Options` for a type and its bounds: `{:ok, option_type}` or
  `{:error, reason}`.

  Values of this type keep their unit. Use `cast/5` to convert them.

      iex> BB.Parameter.Type.option_type(:float, nil, nil)
      {:ok, :float}
      iex> BB.Parameter.Type.option_type(:float, 0.0, nil)
      {:ok,
       {:custom, BB.Parameter.Type, :validate_bounds, [[type: :float, min: 0.0, max: nil]]}}
      iex> BB.Parameter.Type.option_type({:unit, :meter}, nil, BB.Unit.new!(2, :meter))
      {:ok,
       {:custom, BB.Unit.Option, :validate, [[compatible: :meter, max: BB.Unit.new!(2, :meter)]]}}
  """
  @spec option_type(t(), bound(), bound()) :: {:ok, term()} | {:error, String.t()}
  def option_type(type, min, max) do
    with {:ok, type} <- validate(type),
         :ok <- Bounds.check(type, min, max),
         do: {:ok, translate(type, min, max, &unit_option/3)}
  end

  @doc """
  Casts a value to `type:` within `min:` and `max:`, which are inclusive. Returns `{:ok, value}`
  or `{:error, reason}`. It is the function of the `:custom` types of `option_type/3`.

      iex> BB.Parameter.Type.validate_bounds(5.0, type: :float, min: 0.0, max: 1.0)
      {:error, "expected value to be at most 1.0, got: 5.0"}
      iex> BB.Parameter.Type.validate_bounds(1, type: :float, min: 0.0, max: 1.0)
      {:error, "expected float, got: 1"}
  """
  @spec validate_bounds(term(), type: t(), min: bound(), max: bound()) ::
          {:ok, term()} | {:error, String.t()}
  def validate_bounds(value, opts) do
    with {:ok, value} <- cast_unbounded(opts[:type], value),
         :ok <- Bounds.check_value(value, opts[:min], opts[:max]),
         do: {:ok, value}
  end

  @doc """
  Returns the type and the bounds of an option type, `{type, min, max}`.

  It undoes `option_type/3`, and reads the units of `BB.Unit.Option`. All other terms have no
  bounds.

      iex> {:ok, type} = BB.Parameter.Type.option_type(:integer, 1, 5)
      iex> BB.Parameter.Type.describe(type)
      {:integer, 1, 5}
      iex> BB.Parameter.Type.describe(:string)
      {:string, nil, nil}
  """
  @spec describe(term()) :: {term(), bound(), bound()}
  def describe({:custom, __MODULE__, :validate_bounds, [opts]}),
    do: {opts[:type], opts[:min], opts[:max]}

  def describe({:custom, BB.Unit.Option, :validate, [[_ | _] = opts]} = type) do
    case Map.new(opts) do
      %{compatible: unit, eq: %Unit{} = eq} -> {{:unit, unit}, eq, eq}
      %{compatible: unit} -> {{:unit, unit}, quantity(opts[:min]), quantity(opts[:max])}
      _no_unit -> {type, nil, nil}
    end
  end

  def describe({:list, type} = list) do
    case describe(type) do
      {^type, nil, nil} -> {list, nil, nil}
      {type, min, max} -> {{:list, type}, min, max}
    end
  end

  def describe(other), do: {other, nil, nil}

  # BB.Unit.Option does not check a bound that is a reference.
  defp quantity(%Unit{} = bound), do: bound
  defp quantity(_reference), do: nil

  @doc """
  Casts a value to a type within bounds: `{:ok, value}`, or `{:error, error}` about the option
  `key`.

      iex> import BB.Unit
      iex> BB.Parameter.Type.cast({:unit, :hertz}, ~u(1 hertz), nil, ~u(1 kilohertz), :rate)
      {:ok, BB.Unit.new!(1000, :hertz)}
      iex> {:error, error} = BB.Parameter.Type.cast(:float, 0.0, 1.0, 2.5, :gain)
      iex> Exception.message(error)
      "invalid value for :gain option: expected value to be at most 1.0, got: 2.5"
  """
  @spec cast(t(), bound(), bound(), term(), atom()) ::
          {:ok, term()} | {:error, Options.ValidationError.t()}
  def cast(type, min, max, value, key) do
    spec = type |> translate(min, max, &bounded/3) |> spec()

    with {:ok, [{^key, value}]} <- Options.validate([{key, value}], [{key, spec}]),
         do: {:ok, value}
  end

  @doc """
  Returns an option type as the description of an option in a schema of `BB.Options`.

      iex> BB.Parameter.Type.spec({:keyword_list, [gain: [type: :float]]})
      [type: :keyword_list, keys: [gain: [type: :float]]]
  """
  @spec spec(term()) :: keyword()
  def spec({nesting, keys}) when nesting in @nesting, do: [type: nesting, keys: keys]
  def spec(type), do: [type: type]

  @doc "Returns whether a check of the type calls functions outside of this library."
  @spec foreign?(term()) :: boolean()
  def foreign?({:custom, module, _function, _args}), do: module not in @own
  def foreign?({:in, choices}), do: is_struct(choices) and not is_struct(choices, Range)
  def foreign?(type) when is_tuple(type), do: type |> Tuple.to_list() |> foreign?()
  def foreign?([head | tail]), do: foreign?(head) or foreign?(tail)
  def foreign?(_type), do: false

  # Checking a type

  defp check({:unit, unit}) when (is_atom(unit) and not is_nil(unit)) or is_binary(unit) do
    case Unit.new(1, unit) do
      {:ok, _} -> :ok
      {:error, error} -> {:error, Exception.message(error)}
    end
  end

  defp check({:custom, BB.Unit.Option, :validate, [_opts]} = type) do
    case describe(type) do
      {{:unit, _} = unit, min, max} -> with :ok <- check(unit), do: Bounds.check(unit, min, max)
      _no_unit -> :ok
    end
  end

  defp check({name, [_ | _] = types}) when name in [:or, :tuple], do: check_all(types)
  defp check({name, type}) when name in [:list, :wrap_list], do: check(type)
  defp check({:map, keys, values}), do: check_all([keys, values])
  defp check({:in, []} = type), do: unknown(type)

  defp check({:in, choices} = type),
    do: if(Enumerable.impl_for(choices), do: :ok, else: unknown(type))

  defp check({:or, _none} = type), do: unknown(type)

  defp check({nesting, _keys} = type) when nesting in @nesting do
    case Options.new(k: spec(type)) do
      {:ok, _schema} -> :ok
      {:error, error} -> {:error, Exception.message(error)}
    end
  end

  defp check(type) do
    case Options.Type.check(type) do
      {:ok, _type} -> :ok
      {:error, _reason} -> unknown(type)
    end
  end

  defp check_all(types), do: Enum.find_value(types, :ok, &with(:ok <- check(&1), do: nil))

  defp unknown(type) do
    {:error,
     "expected a type, got: #{inspect(type)}; use #{Options.Type.known()}, or {:unit, unit}"}
  end

  # Translating a type

  defp translate({:list, type}, min, max, unit), do: {:list, translate(type, min, max, unit)}
  defp translate({:unit, _} = type, min, max, unit), do: unit.(type, min, max)

  defp translate({:custom, BB.Unit.Option, :validate, [_opts]} = type, nil, nil, unit) do
    case describe(type) do
      {{:unit, _} = type, min, max} -> unit.(type, min, max)
      _no_unit -> type
    end
  end

  defp translate({name, types}, nil, nil, unit) when name in [:or, :tuple],
    do: {name, Enum.map(types, &translate(&1, nil, nil, unit))}

  defp translate({:wrap_list, type}, nil, nil, unit),
    do: {:wrap_list, translate(type, nil, nil, unit)}

  defp translate({:map, keys, values}, nil, nil, unit),
    do: {:map, translate(keys, nil, nil, unit), translate(values, nil, nil, unit)}

  defp translate(type, nil, nil, _unit), do: type
  defp translate(type, min, max, _unit), do: bounded(type, min, max)

  defp bounded(type, min, max),
    do: {:custom, __MODULE__, :validate_bounds, [[type: type, min: min, max: max]]}

  defp unit_option({:unit, unit}, min, max) do
    bounds = for {key, bound} <- [min: min, max: max], bound != nil, do: {key, bound}
    {:custom, BB.Unit.Option, :validate, [[compatible: unit] ++ bounds]}
  end

  # Casting

  defp cast_unbounded({:unit, unit}, value), do: Bounds.cast_unit(value, unit)

  defp cast_unbounded(type, value) do
    prefix = "invalid value for :value option: "

    with {:error, error} <- cast(type, nil, nil, value, :value),
         do: {:error, String.replace_prefix(Exception.message(error), prefix, "")}
  end
end
