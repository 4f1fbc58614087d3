defmodule BB.Parameter.Type do
  @moduledoc """
  The types of parameters. Pure. Use them in the field `type` of `param`:

      param :rate, type: {:unit, :hertz}, default: ~u(100 hertz), min: ~u(1 hertz)

    * `:float`, `:integer`, `:boolean`, `:string`, `:atom` - as in `BB.Options`; a `:float`
      accepts no integer
    * `{:unit, unit}` - a `BB.Unit` that converts to `unit`; its value is stored in `unit`
    * `{:in, choices}` - a member of a list or range
    * `{:or, types}` - the first of the types that fits
    * `{:list, type}` - a list of values of the type

  Numbers, units and lists of them can have bounds, `min:` and `max:`. The bounds of a unit are
  units.
  """

  alias BB.{Options, Unit}

  @plain [:float, :integer, :boolean, :string, :atom]
  @compound "{:unit, unit}, {:in, choices}, {:or, types}, {:list, type}"
  @known "#{Enum.map_join(@plain, ", ", &inspect/1)}, #{@compound}"

  @type t ::
          :float
          | :integer
          | :boolean
          | :string
          | :atom
          | {:unit, Unit.name()}
          | {:in, Enumerable.t()}
          | {:or, [t()]}
          | {:list, t()}

  @type bound :: number() | Unit.t() | nil

  @doc """
  Checks that a term is a type: `:ok`, or `{:error, reason}`.

      iex> BB.Parameter.Type.check({:list, {:unit, :meter}})
      :ok
      iex> BB.Parameter.Type.check({:unit, :metre})
      {:error, ~s(unknown unit "metre"; did you mean meter or ampere?)}
  """
  @spec check(term()) :: :ok | {:error, String.t()}
  def check(type) when type in @plain, do: :ok
  def check({:list, type}), do: check(type)

  def check({:or, [_ | _] = types}),
    do: Enum.find_value(types, :ok, &with(:ok <- check(&1), do: nil))

  def check({:in, %Range{}}), do: :ok
  def check({:in, [_ | _]}), do: :ok

  def check({:unit, unit}) when (is_atom(unit) and not is_nil(unit)) or is_binary(unit) do
    case Unit.new(1, unit) do
      {:ok, _} -> :ok
      {:error, error} -> {:error, Exception.message(error)}
    end
  end

  def check(type), do: {:error, "#{inspect(type)} is no type; the types are #{@known}"}

  @doc "Checks that bounds fit a type and each other: `:ok`, or `{:error, reason}`."
  @spec check_bounds(t(), bound(), bound()) :: :ok | {:error, String.t()}
  def check_bounds(_type, nil, nil), do: :ok

  def check_bounds(type, min, max) do
    element = element(type)

    with :ok <- boundable(element, type),
         :ok <- check_bound(element, :min, min),
         :ok <- check_bound(element, :max, max),
         do: check_order(min, max)
  end

  @doc """
  Casts a value to a type within bounds: `{:ok, value}`, or `{:error, message}` about the option
  `key`.

      iex> import BB.Unit
      iex> BB.Parameter.Type.cast({:unit, :hertz}, ~u(1 hertz), nil, ~u(1 kilohertz), :rate)
      {:ok, BB.Unit.new!(1000, :hertz)}
      iex> BB.Parameter.Type.cast(:float, 0.0, 1.0, 2.5, :gain)
      {:error, "invalid value for :gain option: expected at most 1.0, got: 2.5"}
  """
  @spec cast(t(), bound(), bound(), term(), atom()) :: {:ok, term()} | {:error, String.t()}
  def cast(type, min, max, value, key) do
    with {:ok, [{^key, value}]} <- validate(type, value, key),
         :ok <- check_within(type, min, max, value) do
      {:ok, value}
    else
      {:error, %Options.ValidationError{message: message}} -> {:error, message}
      {:error, message} -> {:error, "invalid value for #{inspect(key)} option: #{message}"}
    end
  end

  defp validate(type, value, key),
    do: Options.validate([{key, value}], [{key, [type: option_type(type)]}])

  @doc false
  def cast_unit(%Unit{value: value} = quantity, unit) when is_number(value) do
    case Unit.convert(quantity, unit) do
      {:ok, quantity} -> {:ok, quantity}
      {:error, error} -> {:error, Exception.message(error)}
    end
  end

  def cast_unit(value, unit) do
    {:error, "expected a quantity such as #{inspect(Unit.new!(1, unit))}, got: #{inspect(value)}"}
  end

  defp option_type({:unit, unit}), do: {:custom, __MODULE__, :cast_unit, [unit]}
  defp option_type({:or, types}), do: {:or, Enum.map(types, &option_type/1)}
  defp option_type({:list, type}), do: {:list, option_type(type)}
  defp option_type(type), do: type

  # Bounds

  defp element({:list, type}), do: element(type)
  defp element(type), do: type

  defp boundable(type, _whole) when type in [:float, :integer], do: :ok
  defp boundable({:unit, _}, _whole), do: :ok

  defp boundable(_type, whole),
    do: {:error, "values of type #{inspect(whole)} have no order; remove min and max"}

  defp check_bound(_type, _which, nil), do: :ok

  defp check_bound({:unit, unit}, which, bound) do
    case cast_unit(bound, unit) do
      {:ok, _} -> :ok
      {:error, reason} -> {:error, "#{which}: #{reason}"}
    end
  end

  defp check_bound(_number, _which, bound) when is_number(bound), do: :ok

  defp check_bound(type, which, bound),
    do: {:error, "#{which}: expected a number for type #{inspect(type)}, got: #{inspect(bound)}"}

  defp check_order(min, max) do
    if is_nil(min) or is_nil(max) or compare(min, max) != :gt,
      do: :ok,
      else: {:error, "min #{inspect(min)} is above max #{inspect(max)}; swap them"}
  end

  defp check_within(_type, nil, nil, _value), do: :ok

  defp check_within({:list, type}, min, max, values),
    do: Enum.find_value(values, :ok, &with(:ok <- check_within(type, min, max, &1), do: nil))

  defp check_within(_type, min, max, value) do
    cond do
      min && compare(value, min) == :lt ->
        {:error, "expected at least #{format_bound(min, value)}"}

      max && compare(value, max) == :gt ->
        {:error, "expected at most #{format_bound(max, value)}"}

      true ->
        :ok
    end
  end

  defp format_bound(bound, value), do: "#{inspect(bound)}, got: #{inspect(value)}"

  defp compare(%Unit{} = a, %Unit{} = b), do: Unit.compare(a, b)
  defp compare(a, b) when a < b, do: :lt
  defp compare(a, b) when a > b, do: :gt
  defp compare(_a, _b), do: :eq
end
