defmodule BB.Unit.Fraction do
  @moduledoc false
  # Exact fractions {numerator, denominator}, with a denominator above zero and without common
  # factors. The factors between units are fractions, and so are the values of quantities that
  # are compared.

  @type t :: {integer(), pos_integer()}

  @doc """
  Returns a number as a fraction.

  A float is the shortest decimal number that denotes it, which is how a person writes it: 0.1 is
  one tenth.
  """
  def new(integer) when is_integer(integer), do: {integer, 1}

  def new(float) when is_float(float) do
    [whole, rest] = float |> Float.to_string() |> String.split(".")
    {digits, exponent} = split_exponent(rest)
    mantissa = String.to_integer(whole <> digits)
    multiply({mantissa, 1}, power({10, 1}, exponent - byte_size(digits)))
  end

  defp split_exponent(text) do
    case String.split(text, "e") do
      [digits] -> {digits, 0}
      [digits, exponent] -> {digits, String.to_integer(exponent)}
    end
  end

  @doc "Returns the product of two fractions."
  def multiply({a, b}, {c, d}), do: reduce(a * c, b * d)

  @doc "Returns the quotient of two fractions."
  def divide(a, {c, d}), do: multiply(a, if(c < 0, do: {-d, -c}, else: {d, c}))

  @doc "Returns the sum of two fractions."
  def add({a, b}, {c, d}), do: reduce(a * d + c * b, b * d)

  @doc "Returns the first fraction minus the second."
  def subtract(a, {c, d}), do: add(a, {-c, d})

  @doc "Returns a fraction to the power of an integer."
  def power(_fraction, 0), do: {1, 1}
  def power(fraction, n) when n > 0, do: multiply(fraction, power(fraction, n - 1))
  def power(fraction, n), do: divide({1, 1}, power(fraction, -n))

  @doc "Compares two fractions. Returns `:lt`, `:eq` or `:gt`."
  def compare({a, b}, {c, d}) do
    case {a * d, c * b} do
      {left, right} when left < right -> :lt
      {left, right} when left > right -> :gt
      _equal -> :eq
    end
  end

  @doc "Returns the number of a fraction: an integer if it is a whole number, otherwise a float."
  def to_number({n, 1}), do: n
  def to_number({n, d}), do: n / d

  defp reduce(a, b) do
    divisor = Integer.gcd(a, b)
    {div(a, divisor), div(b, divisor)}
  end
end
