defmodule BB.Unit.Value do
  @moduledoc false
  # Converts and compares the numbers of quantities.

  alias BB.Unit.{Fraction, Name}

  @doc """
  Converts a number from one unit to another of the same dimensions.

  Integers stay integers where the result is exact.
  """
  def convert(value, from, to) do
    ratio = Fraction.divide(from.ratio, to.ratio)
    shift = from.offset |> Fraction.subtract(to.offset) |> Fraction.divide(to.ratio)
    apply_affine(value, ratio, from.pi - to.pi, shift)
  end

  @doc "Returns a number in the SI unit, as a float."
  def to_si(value, from), do: convert(value, from, %Name{}) / 1

  defp apply_affine(value, ratio, 0, shift) when is_integer(value) do
    {value, 1}
    |> Fraction.multiply(ratio)
    |> Fraction.add(shift)
    |> Fraction.to_number()
  end

  defp apply_affine(value, {n, d}, pi, shift),
    do: value * n / d * :math.pow(:math.pi(), pi) + Fraction.to_number(shift)

  @doc """
  Compares two numbers with their units. Returns `:lt`, `:eq` or `:gt`.

  The comparison is exact: 14.8 centimeter equals 0.148 meter. Only an angle in degrees is
  rounded when it is compared with one in radians.
  """
  def compare({a, %{pi: pi} = from}, {b, %{pi: pi} = to}),
    do: Fraction.compare(exact_si(a, from), exact_si(b, to))

  def compare({a, from}, {b, to}) do
    case {to_si(a, from), to_si(b, to)} do
      {a, b} when a < b -> :lt
      {a, b} when a > b -> :gt
      _equal -> :eq
    end
  end

  defp exact_si(value, unit),
    do: value |> Fraction.new() |> Fraction.multiply(unit.ratio) |> Fraction.add(unit.offset)
end
