defmodule BB.Parameter.Bounds do
  @moduledoc """
  The bounds of parameters: numbers for numbers, and units for units. Pure. `BB.Parameter.Type`
  uses it.

      iex> BB.Parameter.Bounds.check_value(5.0, 0.0, 1.0)
      {:error, "expected value to be at most 1.0, got: 5.0"}
  """

  alias BB.Unit

  @numeric [:float, :integer, :number, :pos_integer, :non_neg_integer]

  @typep bound :: number() | Unit.t() | nil

  @doc """
  Checks that bounds fit a type and each other: `:ok`, or `{:error, reason}`. The bounds of a list
  hold for its elements.

      iex> BB.Parameter.Bounds.check({:unit, :meter}, nil, 2)
      {:error, "`max` must be a `BB.Unit` compatible with `meter`, got: 2"}
      iex> BB.Parameter.Bounds.check(:integer, 2, 1)
      {:error, "`min` must not be greater than `max`, got: 2 and 1; swap them"}
  """
  @spec check(term(), term(), term()) :: :ok | {:error, String.t()}
  def check(_type, nil, nil), do: :ok
  def check({:list, type}, min, max), do: check(type, min, max)

  def check(type, min, max) do
    with :ok <- check_numeric(type),
         :ok <- check_bound(type, :min, min),
         :ok <- check_bound(type, :max, max),
         do: check_order(min, max)
  end

  @doc "Checks that a number or a unit is within bounds: `:ok`, or `{:error, reason}`."
  @spec check_value(term(), bound(), bound()) :: :ok | {:error, String.t()}
  def check_value(value, min, max) do
    cond do
      min != nil and compare(value, min) == :lt -> {:error, outside("least", min, value)}
      max != nil and compare(value, max) == :gt -> {:error, outside("most", max, value)}
      true -> :ok
    end
  end

  @doc """
  Converts a value to a unit: `{:ok, unit}`, or `{:error, reason}`.

      iex> BB.Parameter.Bounds.cast_unit(BB.Unit.new!(1, :kilometer), :meter)
      {:ok, BB.Unit.new!(1000, :meter)}
      iex> BB.Parameter.Bounds.cast_unit(1, :meter)
      {:error, "expected a quantity such as ~u(1 meter), got: 1"}
  """
  @spec cast_unit(term(), Unit.name()) :: {:ok, Unit.t()} | {:error, String.t()}
  def cast_unit(%Unit{value: value} = quantity, unit) when is_number(value) do
    case Unit.convert(quantity, unit) do
      {:ok, quantity} -> {:ok, quantity}
      {:error, error} -> {:error, Exception.message(error)}
    end
  end

  def cast_unit(value, unit) do
    {:error, "expected a quantity such as #{inspect(Unit.new!(1, unit))}, got: #{inspect(value)}"}
  end

  defp check_numeric({:unit, _}), do: :ok
  defp check_numeric(type) when type in @numeric, do: :ok

  defp check_numeric(type) do
    {:error,
     "`min` and `max` are only supported for numeric parameter types, " <>
       "got: #{inspect(type)}; remove them"}
  end

  defp check_bound(_type, _which, nil), do: :ok

  defp check_bound({:unit, unit}, which, %Unit{} = bound) do
    case cast_unit(bound, unit) do
      {:ok, _} -> :ok
      {:error, _} -> wrong_bound(which, "be compatible with `#{unit}`", bound)
    end
  end

  defp check_bound({:unit, unit}, which, bound),
    do: wrong_bound(which, "be a `BB.Unit` compatible with `#{unit}`", bound)

  defp check_bound(_number, _which, bound) when is_number(bound), do: :ok
  defp check_bound(_number, which, bound), do: wrong_bound(which, "be a number", bound)

  defp wrong_bound(which, wanted, bound),
    do: {:error, "`#{which}` must #{wanted}, got: #{inspect(bound)}"}

  defp check_order(min, max) do
    if is_nil(min) or is_nil(max) or compare(min, max) != :gt do
      :ok
    else
      {:error,
       "`min` must not be greater than `max`, got: #{inspect(min)} and #{inspect(max)}; " <>
         "swap them"}
    end
  end

  defp outside(side, bound, value),
    do: "expected value to be at #{side} #{inspect(bound)}, got: #{inspect(value)}"

  defp compare(%Unit{} = a, %Unit{} = b), do: Unit.compare!(a, b)
  defp compare(a, b) when a < b, do: :lt
  defp compare(a, b) when a > b, do: :gt
  defp compare(_a, _b), do: :eq
end
