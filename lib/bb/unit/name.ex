defmodule BB.Unit.Name do
  @moduledoc false
  # Parses the name of a unit into its dimensions and the conversion of its values into the
  # coherent SI unit: v · ratio · πᵖⁱ + offset, with ratio and offset as exact fractions.
  #
  # The angle is a dimension, so that an angular speed is not a frequency.

  alias BB.Unit.Fraction

  defstruct dimensions: %{}, ratio: {1, 1}, pi: 0, offset: {0, 1}

  @type dimensions :: %{atom() => integer()}

  @type t :: %__MODULE__{
          dimensions: dimensions(),
          ratio: Fraction.t(),
          pi: integer(),
          offset: Fraction.t()
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

  # The units that take prefixes.
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

  @doc "Returns all units without prefixes."
  def known, do: Enum.sort(Map.keys(@known))

  @doc "Returns the prefixes with their powers of ten."
  def prefixes, do: @prefixes

  @doc "Returns the units that take prefixes."
  def metric, do: @prefixable

  @doc "Returns a name in its stored form, a string with dashes between its words."
  def normalize(name) when is_atom(name) and name != nil, do: normalize(Atom.to_string(name))
  def normalize(name) when is_binary(name), do: String.replace(name, "_", "-")

  def normalize(name), do: raise(ArgumentError, invalid_message(name))

  @doc "Returns the message for a term that cannot be a name."
  def invalid_message(name),
    do: "expected an atom or a string as the name of a unit, got: #{inspect(name)}"

  @doc "Parses a normalized name. Returns `{:ok, t}`, or `{:error, message}` with similar names."
  def parse(name) do
    with {:ok, factors} <- factors(name), do: {:ok, product(factors)}
  end

  @doc """
  Splits a normalized name into its factors.

  Returns `{:ok, factors}` or `{:error, message}`. A factor is `{prefix, unit, power}`, such as
  `{"kilo", "meter", -1}`, with `nil` for no prefix.
  """
  def factors(name) do
    case factors(String.split(name, "-"), 1, []) do
      {:ok, factors} -> {:ok, factors}
      {:unknown, word} -> {:error, unknown_unit_message(name, word)}
      :incomplete -> {:error, "expected a complete unit, got: #{inspect(name)}"}
    end
  end

  # The offset applies to a unit alone. In a rate or a product, a temperature is a difference.
  defp product([{prefix, unit, 1}]), do: struct!(__MODULE__, meaning(prefix, unit))

  defp product(factors) do
    Enum.reduce(factors, %__MODULE__{}, fn {prefix, unit, power}, product ->
      unit = meaning(prefix, unit)

      %{
        product
        | dimensions: add_dimensions(product.dimensions, unit.dimensions, power),
          ratio: Fraction.multiply(product.ratio, Fraction.power(unit.ratio, power)),
          pi: product.pi + power * Map.get(unit, :pi, 0)
      }
    end)
  end

  defp meaning(nil, unit), do: Map.fetch!(@known, unit)

  defp meaning(prefix, unit) do
    {^prefix, exponent} = List.keyfind(@prefixes, prefix, 0)
    unit = Map.fetch!(@known, unit)
    %{unit | ratio: Fraction.multiply(unit.ratio, Fraction.power({10, 1}, exponent))}
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

  # Two words may be one unit, such as "pound-force", even if the first word is a unit too.
  defp factor([word | rest], sign, power, found) do
    pair = "#{word}-#{List.first(rest)}"

    case {Map.has_key?(@known, pair), split_prefix(word)} do
      {true, _} -> factors_with_power(tl(rest), sign, power, {nil, pair}, found)
      {false, {:ok, unit}} -> factors_with_power(rest, sign, power, unit, found)
      {false, :error} -> {:unknown, word}
    end
  end

  defp factors_with_power(["squared" | rest], sign, power, unit, found),
    do: put_factor(rest, sign, power * 2, unit, found)

  defp factors_with_power(["cubed" | rest], sign, power, unit, found),
    do: put_factor(rest, sign, power * 3, unit, found)

  defp factors_with_power(rest, sign, power, unit, found),
    do: put_factor(rest, sign, power, unit, found)

  defp put_factor(rest, sign, power, {prefix, unit}, found),
    do: factors(rest, sign, [{prefix, unit, sign * power} | found])

  defp split_prefix(word) when is_map_key(@known, word), do: {:ok, {nil, word}}

  defp split_prefix(word) do
    Enum.find_value(@prefixes, :error, fn {prefix, _exponent} ->
      with true <- String.starts_with?(word, prefix),
           unit = binary_part(word, byte_size(prefix), byte_size(word) - byte_size(prefix)),
           true <- unit in @prefixable,
           do: {:ok, {prefix, unit}},
           else: (_ -> nil)
    end)
  end

  defp unknown_unit_message(name, word) do
    place = if name == word, do: "", else: " in #{inspect(name)}"

    case similar_to(word) do
      [] ->
        "unknown unit #{inspect(word)}#{place}, the units are: " <>
          "#{Enum.join(known(), ", ")}, some with SI prefixes"

      similar ->
        "unknown unit #{inspect(word)}#{place}; did you mean #{Enum.join(similar, " or ")}?"
    end
  end

  defp similar_to(word) do
    prefixed = for {prefix, _} <- @prefixes, base <- metric(), do: prefix <> base

    (known() ++ prefixed)
    |> Enum.map(&{String.jaro_distance(&1, word), &1})
    |> Enum.filter(fn {similarity, _} -> similarity > 0.8 end)
    |> Enum.sort(:desc)
    |> Enum.take(3)
    |> Enum.map(&elem(&1, 1))
  end
end
