defmodule BB.Unit.Text do
  @moduledoc false
  # Parses and formats quantities: with the words of their units, or with symbols such as m/s.

  alias BB.Unit.Name

  @prefixes %{
    "quecto" => "q",
    "ronto" => "r",
    "yocto" => "y",
    "zepto" => "z",
    "atto" => "a",
    "femto" => "f",
    "pico" => "p",
    "nano" => "n",
    "micro" => "µ",
    "milli" => "m",
    "centi" => "c",
    "deci" => "d",
    "deca" => "da",
    "deka" => "da",
    "hecto" => "h",
    "kilo" => "k",
    "mega" => "M",
    "giga" => "G",
    "tera" => "T",
    "peta" => "P",
    "exa" => "E",
    "zetta" => "Z",
    "yotta" => "Y",
    "ronna" => "R",
    "quetta" => "Q"
  }

  @units %{
    "meter" => "m",
    "gram" => "g",
    "second" => "s",
    "ampere" => "A",
    "kelvin" => "K",
    "radian" => "rad",
    "hertz" => "Hz",
    "newton" => "N",
    "pascal" => "Pa",
    "bar" => "bar",
    "joule" => "J",
    "watt" => "W",
    "coulomb" => "C",
    "volt" => "V",
    "ohm" => "Ω",
    "farad" => "F",
    "henry" => "H",
    "tesla" => "T",
    "liter" => "L",
    "inch" => "in",
    "foot" => "ft",
    "mile" => "mi",
    "minute" => "min",
    "hour" => "h",
    "day" => "d",
    "tonne" => "t",
    "ounce" => "oz",
    "pound" => "lb",
    "pound-force" => "lbf",
    "kilogram-force" => "kgf",
    "g-force" => "g₀",
    "percent" => "%",
    "degree" => "°",
    "arc-minute" => "′",
    "arc-second" => "″",
    "revolution" => "rev",
    "celsius" => "°C",
    "fahrenheit" => "°F"
  }

  # These symbols follow their number without a space.
  @attached ~w(° ′ ″ %)

  @styles [:long, :short, :narrow]

  @doc """
  Splits a text such as `5 meter` or `-1_000millidegree` into its number and the name of a unit.

  Returns `{:ok, number, name}` or `:error`. A number without a decimal point and without an
  exponent is an integer.
  """
  def parse(text) do
    quantity = ~r/\A\s*([+-]?\d+(?:_\d+)*)(\.\d+)?([eE][+-]?\d+)?\s*([[:alpha:]]\S*)\s*\z/

    with [whole, fraction, exponent, name] <- Regex.run(quantity, text, capture: :all_but_first),
         {:ok, number} <- parse_number(String.replace(whole, "_", ""), fraction, exponent),
         do: {:ok, number, name},
         else: (_ -> :error)
  end

  defp parse_number(whole, "", ""), do: {:ok, String.to_integer(whole)}
  defp parse_number(whole, "", exponent), do: parse_float(whole <> ".0" <> exponent)
  defp parse_number(whole, fraction, exponent), do: parse_float(whole <> fraction <> exponent)

  # A number beyond the largest float is none.
  defp parse_float(text) do
    {:ok, String.to_float(text)}
  rescue
    ArgumentError -> :error
  end

  @doc "Returns the styles: words, symbols, and symbols without a space."
  def styles, do: @styles

  @doc "Formats a number with the name of its unit."
  def format(value, name, :long), do: "#{value} #{words(name)}"

  def format(value, name, style) when style in [:short, :narrow] do
    symbol = symbol(name)
    space = if style == :narrow or symbol in @attached, do: "", else: " "
    "#{value}#{space}#{symbol}"
  end

  @doc "Returns the words of a unit's name."
  def words(name), do: name |> Name.normalize() |> String.replace("-", " ")

  defp symbol(name) do
    {:ok, factors} = name |> Name.normalize() |> Name.factors()
    {above, below} = Enum.split_with(factors, fn {_prefix, _unit, power} -> power > 0 end)
    quotient(join(above), length(below), join(below))
  end

  defp quotient(above, 0, _below), do: above
  defp quotient("", count, below), do: quotient("1", count, below)
  defp quotient(above, 1, below), do: "#{above}/#{below}"
  defp quotient(above, _count, below), do: "#{above}/(#{below})"

  defp join(factors), do: Enum.map_join(factors, "·", &factor/1)

  defp factor({prefix, unit, power}),
    do: "#{@prefixes[prefix]}#{Map.fetch!(@units, unit)}#{exponent(abs(power))}"

  defp exponent(1), do: ""
  defp exponent(2), do: "²"
  defp exponent(3), do: "³"
  defp exponent(power), do: "^#{power}"
end
