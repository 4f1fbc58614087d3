defmodule BB.Unit do
  @moduledoc """
  Quantities: numbers with a unit.

  Use them in a robot's declaration, in options and in parameters, where a reader would otherwise
  have to guess whether a limit is in degrees or radians:

      iex> import BB.Unit
      iex> ~u(5 meter_per_second)
      %BB.Unit{name: "meter-per-second", value: 5}
      iex> BB.Unit.convert!(~u(90 degree), :radian).value
      1.5707963267948966

  Messages and calculations use plain floats in SI units instead, which `to_si/1` and
  `BB.Robot.Units` return. Options that are quantities have the types of `BB.Unit.Option`.

  `import BB.Unit` imports the functions too. A module that calls functions of its own with such
  names, say `parse/1`, writes `import BB.Unit, only: :sigils`.

  ## Names

  The name of a unit is an atom or a string, with `_` or `-` between its words. The units are

  #{Enum.map_join(BB.Unit.Name.metric(), ", ", &"`#{&1}`")}

  with or without an SI prefix (`milli`, `kilo`, …), and

  #{Enum.map_join(BB.Unit.Name.known() -- BB.Unit.Name.metric(), ", ", &"`#{&1}`")}.

  They combine: `newton_meter` is a product, `meter_per_second` a quotient (every unit after `per`
  divides), and `square_meter`, `cubic_meter`, `meter_per_square_second` and
  `meter_per_second_squared` are powers. Quantities of the same dimensions can be converted and
  compared, whatever their names: a `volt_ampere` is a `watt`. An angle is a dimension of its own,
  so `radian_per_second` is not a `hertz`.

  A temperature in `celsius` or `fahrenheit` counts from the zero of its scale. In a rate or a
  product, such as `celsius_per_second`, it is a difference.
  """

  alias BB.Unit.{Kind, Name, Text, Value}

  @enforce_keys [:name, :value]
  defstruct [:name, :value]

  @type t :: %__MODULE__{name: String.t(), value: number()}

  @typedoc "The name of a unit, such as `:meter_per_second` or `\"meter-per-second\"`."
  @type name :: atom() | String.t()

  @doc """
  Handles the sigil `~u`, a quantity that is checked when compiled.

  An unknown unit raises `CompileError`.
  """
  defmacro sigil_u({:<<>>, _, [text]}, []) when is_binary(text) do
    case parse(text) do
      {:ok, unit} -> Macro.escape(unit)
      {:error, error} -> compile_error(__CALLER__, Exception.message(error))
    end
  end

  defmacro sigil_u(_text, _modifiers) do
    compile_error(
      __CALLER__,
      "expected a number and a unit in ~u, such as ~u(5 meter_per_second), without " <>
        "interpolation or modifiers; use BB.Unit.new!/2 for values that are known later"
    )
  end

  @doc """
  Creates a quantity of a value and a name, in either order.

  Returns `{:ok, unit}` or `{:error, exception}`.

      iex> BB.Unit.new(100, :hertz)
      {:ok, %BB.Unit{name: "hertz", value: 100}}
      iex> {:error, error} = BB.Unit.new(1, :metre)
      iex> error.message
      ~s(unknown unit "metre"; did you mean meter or ampere?)
  """
  @spec new(number(), name()) :: {:ok, t()} | {:error, Exception.t()}
  @spec new(name(), number()) :: {:ok, t()} | {:error, Exception.t()}
  def new(value, name) when is_number(value) do
    with {:ok, name, _meaning} <- parse_name(name),
         do: {:ok, %__MODULE__{name: name, value: value}}
  end

  def new(name, value) when is_number(value), do: new(value, name)

  def new(value, name) do
    raise ArgumentError,
          "expected a number and the name of a unit, got: #{inspect(value)} and #{inspect(name)}"
  end

  @doc """
  Creates the quantity 1 of a unit. Returns as `new/2` does.

      iex> BB.Unit.new("meter")
      {:ok, %BB.Unit{name: "meter", value: 1}}
  """
  @spec new(name()) :: {:ok, t()} | {:error, Exception.t()}
  def new(name), do: new(1, name)

  @doc "Creates a quantity as `new/2` does. Returns it or raises `ArgumentError`."
  @spec new!(number(), name()) :: t()
  @spec new!(name(), number()) :: t()
  def new!(value, name), do: unwrap!(new(value, name))

  @doc """
  Returns the name of a unit as a quantity has it, with dashes. It does not check that the unit
  exists.

      iex> BB.Unit.unit_name(:newton_meter)
      "newton-meter"
  """
  @spec unit_name(name()) :: String.t()
  def unit_name(name) when is_atom(name) or is_binary(name),
    do: name |> to_string() |> String.replace("_", "-")

  @doc """
  Checks the name of a unit. Returns `{:ok, name}`, with dashes, or `{:error, exception}`.

      iex> BB.Unit.validate_unit(:meter_per_second)
      {:ok, "meter-per-second"}
      iex> {:error, error} = BB.Unit.validate_unit(:metre)
      iex> Exception.message(error)
      ~s(unknown unit "metre"; did you mean meter or ampere?)
  """
  @spec validate_unit(name()) :: {:ok, String.t()} | {:error, Exception.t()}
  def validate_unit(name) when (is_atom(name) and not is_nil(name)) or is_binary(name) do
    with {:ok, name, _meaning} <- parse_name(name), do: {:ok, name}
  end

  def validate_unit(other), do: error(Name.invalid_message(other))

  @doc """
  Parses a text such as `"5 meter_per_second"`. The blank may be missing.

  Returns `{:ok, unit}` or `{:error, exception}`.

      iex> BB.Unit.parse("-1.5 newton-meter")
      {:ok, %BB.Unit{name: "newton-meter", value: -1.5}}
      iex> BB.Unit.parse("100centimeter")
      {:ok, %BB.Unit{name: "centimeter", value: 100}}
  """
  @spec parse(String.t()) :: {:ok, t()} | {:error, Exception.t()}
  def parse(text) when is_binary(text) do
    case Text.parse(text) do
      {:ok, value, name} ->
        new(value, name)

      :error ->
        error("expected a number and a unit, such as 5 meter_per_second, got: #{inspect(text)}")
    end
  end

  @doc """
  Converts a quantity to another unit.

  Returns `{:ok, unit}` or `{:error, exception}`. Integers stay integers where the result is
  exact.

      iex> import BB.Unit
      iex> BB.Unit.convert(~u(1.5 kilohertz), :hertz)
      {:ok, %BB.Unit{name: "hertz", value: 1500.0}}
      iex> BB.Unit.convert(~u(100 celsius), :fahrenheit)
      {:ok, %BB.Unit{name: "fahrenheit", value: 212}}
      iex> {:error, error} = BB.Unit.convert(~u(1 meter), :second)
      iex> error.message
      "cannot convert 1 meter to second: 1 meter is a length, second is a time"
  """
  @spec convert(t(), name()) :: {:ok, t()} | {:error, Exception.t()}
  def convert(%__MODULE__{} = unit, name) do
    with {:ok, _, from} <- parse_name(unit.name),
         {:ok, name, to} <- parse_name(name) do
      if from.dimensions == to.dimensions,
        do: {:ok, %__MODULE__{name: name, value: Value.convert(unit.value, from, to)}},
        else: error(different_message("convert", {unit, from}, "to", {name, to}))
    end
  end

  @doc "Converts a quantity as `convert/2` does. Returns it or raises `ArgumentError`."
  @spec convert!(t(), name()) :: t()
  def convert!(unit, name), do: unwrap!(convert(unit, name))

  @doc """
  Returns the value in SI units, as a float.

  The units are metres, kilograms, seconds, amperes, kelvins, radians, and those made of them,
  such as hertz, newtons, newton metres, volts, ohms and radians per second.

      iex> import BB.Unit
      iex> BB.Unit.to_si(~u(20 millisecond))
      0.02
      iex> BB.Unit.to_si(~u(0 celsius))
      273.15
  """
  @spec to_si(t()) :: float()
  def to_si(%__MODULE__{} = unit) do
    {:ok, _, from} = parse_name(unit.name)
    Value.to_si(unit.value, from)
  end

  @doc """
  Compares two quantities. Returns `:lt`, `:eq` or `:gt`, as `Enum.sort(units, BB.Unit)` needs it.

  Returns `{:error, exception}` if they have different dimensions.

      iex> import BB.Unit
      iex> BB.Unit.compare(~u(999 meter), ~u(1 kilometer))
      :lt
      iex> BB.Unit.compare(~u(150 centimeter), ~u(1.5 meter))
      :eq
      iex> {:error, error} = BB.Unit.compare(~u(1 meter), ~u(1 second))
      iex> Exception.message(error)
      "cannot compare 1 meter with 1 second: 1 meter is a length, 1 second is a time"
  """
  @spec compare(t(), t()) :: :lt | :eq | :gt | {:error, Exception.t()}
  def compare(%__MODULE__{} = a, %__MODULE__{} = b) do
    with {:ok, _, from} <- parse_name(a.name),
         {:ok, _, to} <- parse_name(b.name) do
      if from.dimensions == to.dimensions,
        do: Value.compare({a.value, from}, {b.value, to}),
        else: error(different_message("compare", {a, from}, "with", {b, to}))
    end
  end

  @doc """
  Compares two quantities as `compare/2` does. Raises `ArgumentError` if they have different
  dimensions.
  """
  @spec compare!(t(), t()) :: :lt | :eq | :gt
  def compare!(a, b) do
    with {:error, error} <- compare(a, b), do: raise(error)
  end

  @doc """
  Returns whether two quantities or units have the same dimensions, so that each can be converted
  to the other.

      iex> import BB.Unit
      iex> BB.Unit.compatible?(~u(1 inch), :meter)
      true
      iex> BB.Unit.compatible?(:hertz, :radian_per_second)
      false
  """
  @spec compatible?(t() | name(), t() | name()) :: boolean()
  def compatible?(a, b), do: dimensions!(a) == dimensions!(b)

  @doc """
  Returns a quantity as text, or a list of quantities, separated by commas.

  The option `style:` is `:long` (the default), `:short` or `:narrow`.

      iex> import BB.Unit
      iex> BB.Unit.to_string!(~u(5 meter_per_second))
      "5 meter per second"
      iex> BB.Unit.to_string!(~u(5 meter_per_second), style: :short)
      "5 m/s"
      iex> BB.Unit.to_string!([~u(5 foot), ~u(3 inch)], style: :narrow)
      "5ft, 3in"
  """
  @spec to_string!(t() | [t()], style: :long | :short | :narrow) :: String.t()
  def to_string!(unit, opts \\ [])

  def to_string!(%__MODULE__{} = unit, opts),
    do: Text.format(unit.value, unit.name, style!(opts))

  def to_string!(units, opts) when is_list(units),
    do: Enum.map_join(units, ", ", &to_string!(&1, opts))

  @doc """
  Returns the type of an option that is a quantity, for the schemas of `BB.Options`.

  The option takes a number in the unit `name`, or a quantity that can be converted to it and
  becomes such a number. The number must be between `least` and `most`.

      iex> schema = [rate: [type: BB.Unit.option(:hertz, 4, 1000)]]
      iex> BB.Options.validate([rate: BB.Unit.new!(0.5, :kilohertz)], schema)
      {:ok, [rate: 500.0]}
      iex> {:error, error} = BB.Options.validate([rate: 3], schema)
      iex> Exception.message(error)
      "invalid value for :rate option: expected a frequency of 4 to 1000 hertz, " <>
        "as a number or a unit, got: 3"
  """
  @spec option(name(), number(), number()) :: {:custom, module(), atom(), [term()]}
  def option(name, least, most), do: {:custom, __MODULE__, :check_option, [name, least, most]}

  @doc false
  def check_option(value, name, least, most) do
    with {:ok, number} <- number_in(value, name), true <- number >= least and number <= most do
      {:ok, number}
    else
      _ ->
        {:error,
         "expected #{Kind.describe(dimensions!(name))} of #{least} to #{most} " <>
           "#{Text.words(name)}, as a number or a unit, got: #{inspect(value)}"}
    end
  end

  defp number_in(%__MODULE__{} = unit, name) do
    with {:ok, unit} <- convert(unit, name), do: {:ok, unit.value}
  end

  defp number_in(number, _name) when is_number(number), do: {:ok, number}
  defp number_in(_other, _name), do: :error

  defp style!(opts) do
    style = Keyword.get(opts, :style, :long)

    if style in Text.styles(),
      do: style,
      else:
        raise(ArgumentError, "expected :long, :short or :narrow as style, got: #{inspect(style)}")
  end

  defp parse_name(name) do
    name = Name.normalize(name)

    case Name.parse(name) do
      {:ok, meaning} -> {:ok, name, meaning}
      {:error, message} -> error(message)
    end
  end

  defp dimensions!(%__MODULE__{name: name}), do: dimensions!(name)
  defp dimensions!(name), do: elem(unwrap_meaning!(parse_name(name)), 2).dimensions

  defp unwrap_meaning!({:ok, _, _} = meaning), do: meaning
  defp unwrap_meaning!({:error, error}), do: raise(error)

  defp unwrap!({:ok, unit}), do: unit
  defp unwrap!({:error, error}), do: raise(error)

  defp error(message), do: {:error, ArgumentError.exception(message)}

  defp different_message(verb, {unit, from}, preposition, {other, to}) do
    {unit, other} = {show(unit), show(other)}

    "cannot #{verb} #{unit} #{preposition} #{other}: #{unit} is " <>
      "#{Kind.describe(from.dimensions)}, #{other} is #{Kind.describe(to.dimensions)}"
  end

  defp show(%__MODULE__{} = unit), do: to_string!(unit)
  defp show(name), do: name

  defp compile_error(env, text),
    do: raise(CompileError, file: env.file, line: env.line, description: text)
end

defimpl String.Chars, for: BB.Unit do
  defdelegate to_string(unit), to: BB.Unit, as: :to_string!
end

defimpl Inspect, for: BB.Unit do
  def inspect(unit, _opts), do: "~u(#{unit.value} #{String.replace(unit.name, "-", "_")})"
end
