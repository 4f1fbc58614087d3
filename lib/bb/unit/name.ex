defmodule BB.Unit.Name do
  @moduledoc false
  # What the name of a unit means: its dimensions, and how its values become values in the coherent SI unit of these,
  # v · ratio · πᵖⁱ + offset, with ratio and offset as exact fractions.
  #
  # The angle counts as a dimension, so that a rotation's speed is no frequency.

  defstruct dimensions: %{}, ratio: {1, 1}, pi: 0, offset: {0, 1}

  @type fraction :: {integer(), pos_integer()}
  @type t :: %__MODULE__{
          dimensions: %{atom() => integer()},
          ratio: fraction(),
          pi: integer(),
          offset: fraction()
        }

  @prefixes [
    {"quecto", -30},
    {"ronto", -27},
    {"yocto", -24},
    {"zepto", -21},
    {"atto", -18},
    {"femto", -15},
    {"pico", -12},
    {"nano", -9},
    {"micro", -6},
    {"milli", -3},
    {"centi", -2},
    {"deci", -1},
    {"deca", 1},
    {"deka", 1},
    {"hecto", 2},
    {"kilo", 3},
    {"mega", 6},
    {"giga", 9},
    {"tera", 12},
    {"peta", 15},
    {"exa", 18},
    {"zetta", 21},
    {"yotta", 24},
    {"ronna", 27},
    {"quetta", 30}
  ]

  @force %{length: 1, mass: 1, time: -2}
  @voltage %{length: 2, mass: 1, time: -3, current: -1}

  # Those that take prefixes.
  @metric %{
    "meter" => {%{length: 1}, {1, 1}},
    "gram" => {%{mass: 1}, {1, 1000}},
    "second" => {%{time: 1}, {1, 1}},
    "ampere" => {%{current: 1}, {1, 1}},
    "kelvin" => {%{temperature: 1}, {1, 1}},
    "radian" => {%{angle: 1}, {1, 1}},
    "hertz" => {%{time: -1}, {1, 1}},
    "newton" => {@force, {1, 1}},
    "pascal" => {%{length: -1, mass: 1, time: -2}, {1, 1}},
    "bar" => {%{length: -1, mass: 1, time: -2}, {100_000, 1}},
    "joule" => {%{length: 2, mass: 1, time: -2}, {1, 1}},
    "watt" => {%{length: 2, mass: 1, time: -3}, {1, 1}},
    "coulomb" => {%{current: 1, time: 1}, {1, 1}},
    "volt" => {@voltage, {1, 1}},
    "ohm" => {%{length: 2, mass: 1, time: -3, current: -2}, {1, 1}},
    "farad" => {%{length: -2, mass: -1, time: 4, current: 2}, {1, 1}},
    "henry" => {%{length: 2, mass: 1, time: -2, current: -2}, {1, 1}},
    "tesla" => {%{mass: 1, time: -2, current: -1}, {1, 1}},
    "liter" => {%{length: 3}, {1, 1000}}
  }

  @others %{
    "inch" => {%{length: 1}, {254, 10_000}},
    "foot" => {%{length: 1}, {3048, 10_000}},
    "mile" => {%{length: 1}, {1_609_344, 1000}},
    "minute" => {%{time: 1}, {60, 1}},
    "hour" => {%{time: 1}, {3600, 1}},
    "day" => {%{time: 1}, {86_400, 1}},
    "tonne" => {%{mass: 1}, {1000, 1}},
    "ounce" => {%{mass: 1}, {45_359_237, 1_600_000_000}},
    "pound" => {%{mass: 1}, {45_359_237, 100_000_000}},
    "pound-force" => {@force, {44_482_216_152_605, 10_000_000_000_000}},
    "kilogram-force" => {@force, {980_665, 100_000}},
    "g-force" => {%{length: 1, time: -2}, {980_665, 100_000}},
    "percent" => {%{}, {1, 100}}
  }

  @of_pi %{
    "degree" => {1, 180},
    "arc-minute" => {1, 10_800},
    "arc-second" => {1, 648_000},
    "revolution" => {2, 1}
  }

  @with_offset %{
    "celsius" => {{1, 1}, {27_315, 100}},
    "fahrenheit" => {{5, 9}, {45_967, 180}}
  }

  @known (for {name, {dimensions, ratio}} <- Map.merge(@metric, @others), into: %{} do
            {name, %{dimensions: dimensions, ratio: ratio}}
          end)
         |> Map.merge(
           for {name, ratio} <- @of_pi, into: %{} do
             {name, %{dimensions: %{angle: 1}, ratio: ratio, pi: 1}}
           end
         )
         |> Map.merge(
           for {name, {ratio, offset}} <- @with_offset, into: %{} do
             {name, %{dimensions: %{temperature: 1}, ratio: ratio, offset: offset}}
           end
         )

  @prefixable Enum.sort(["degree" | Map.keys(@metric)])

  @doc "Every unit that has a name of its own, without prefixes."
  def known, do: Enum.sort(Map.keys(@known))

  @doc "The prefixes, with their powers of ten."
  def prefixes, do: @prefixes

  @doc "The units that take prefixes."
  def metric, do: @prefixable

  @doc "The name as it is kept: a string whose words are joined by dashes."
  def normalise(name) when is_atom(name) and name != nil, do: normalise(Atom.to_string(name))
  def normalise(name) when is_binary(name), do: String.replace(name, "_", "-")

  def normalise(name),
    do: raise(ArgumentError, "the name of a unit is an atom or a string, got: #{inspect(name)}")

  @doc "What a normalised name means: `{:ok, t}`, or `{:error, message}` that names close ones."
  def parse(name) do
    with {:ok, factors} <- factors(String.split(name, "-"), 1, []) do
      {:ok, product(factors)}
    else
      {:unknown, word} -> {:error, unknown(name, word)}
      :incomplete -> {:error, "the unit #{inspect(name)} is not complete"}
    end
  end

  # An offset has a meaning where the unit stands alone; in a rate or a product a temperature is a difference.
  defp product([{unit, 1}]), do: struct!(__MODULE__, unit)

  defp product(factors) do
    Enum.reduce(factors, %__MODULE__{}, fn {unit, power}, product ->
      %{
        product
        | dimensions: add_dimensions(product.dimensions, unit.dimensions, power),
          ratio: multiply(product.ratio, power(unit.ratio, power)),
          pi: product.pi + power * Map.get(unit, :pi, 0)
      }
    end)
  end

  defp add_dimensions(dimensions, more, power) do
    more
    |> Enum.reduce(dimensions, fn {d, n}, sum ->
      Map.update(sum, d, n * power, &(&1 + n * power))
    end)
    |> Map.reject(fn {_, n} -> n == 0 end)
  end

  defp factors([], _sign, []), do: :incomplete
  defp factors([], _sign, found), do: {:ok, Enum.reverse(found)}
  defp factors(["per"], _sign, _found), do: :incomplete
  defp factors(["per" | rest], _sign, found), do: factors(rest, -1, found)
  defp factors(["square" | rest], sign, found), do: factor(rest, sign, 2, found)
  defp factors(["cubic" | rest], sign, found), do: factor(rest, sign, 3, found)
  defp factors(rest, sign, found), do: factor(rest, sign, 1, found)

  defp factor([], _sign, _power, _found), do: :incomplete

  # Two words may be one unit, as "pound-force", also where the first word is one by itself.
  defp factor([word | rest], sign, power, found) do
    pair = "#{word}-#{List.first(rest)}"

    case {@known, lookup(word)} do
      {%{^pair => unit}, _} -> squared(tl(rest), sign, power, unit, found)
      {_, {:ok, unit}} -> squared(rest, sign, power, unit, found)
      {_, :error} -> {:unknown, word}
    end
  end

  defp squared(["squared" | rest], sign, power, unit, found),
    do: factors(rest, sign, [{unit, sign * power * 2} | found])

  defp squared(["cubed" | rest], sign, power, unit, found),
    do: factors(rest, sign, [{unit, sign * power * 3} | found])

  defp squared(rest, sign, power, unit, found),
    do: factors(rest, sign, [{unit, sign * power} | found])

  defp lookup(word), do: with(:error <- Map.fetch(@known, word), do: prefixed(word, @prefixes))

  defp prefixed(_word, []), do: :error

  defp prefixed(word, [{prefix, exponent} | rest]) do
    with true <- String.starts_with?(word, prefix),
         base = binary_part(word, byte_size(prefix), byte_size(word) - byte_size(prefix)),
         true <- base in @prefixable do
      unit = Map.fetch!(@known, base)
      {:ok, %{unit | ratio: multiply(unit.ratio, power({10, 1}, exponent))}}
    else
      _ -> prefixed(word, rest)
    end
  end

  defp unknown(name, word) do
    place = if name == word, do: "", else: " in #{inspect(name)}"

    case close_to(word) do
      [] ->
        "unknown unit #{inspect(word)}#{place}; known are #{Enum.join(known(), ", ")}, also with SI prefixes"

      close ->
        "unknown unit #{inspect(word)}#{place}; close ones are #{Enum.join(close, ", ")}"
    end
  end

  defp close_to(word) do
    prefixed = for {prefix, _} <- @prefixes, base <- metric(), do: prefix <> base

    (known() ++ prefixed)
    |> Enum.map(&{String.jaro_distance(&1, word), &1})
    |> Enum.filter(fn {closeness, _} -> closeness > 0.8 end)
    |> Enum.sort(:desc)
    |> Enum.take(3)
    |> Enum.map(&elem(&1, 1))
  end

  @doc "The product of two fractions."
  def multiply({a, b}, {c, d}), do: reduce(a * c, b * d)

  @doc "The quotient of two fractions."
  def divide(a, {c, d}), do: multiply(a, if(c < 0, do: {-d, -c}, else: {d, c}))

  @doc "The sum of two fractions."
  def add({a, b}, {c, d}), do: reduce(a * d + c * b, b * d)

  @doc "The first fraction less the second."
  def subtract(a, {c, d}), do: add(a, {-c, d})

  defp power(_fraction, 0), do: {1, 1}
  defp power(fraction, n) when n > 0, do: multiply(fraction, power(fraction, n - 1))
  defp power(fraction, n), do: divide({1, 1}, power(fraction, -n))

  defp reduce(a, b) do
    divisor = Integer.gcd(a, b)
    {div(a, divisor), div(b, divisor)}
  end
end
