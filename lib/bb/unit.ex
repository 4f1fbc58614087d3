defmodule BB.Unit do
  @moduledoc """
  Quantities: numbers with their unit, so that nobody has to guess whether a limit is in degrees or radians.

      iex> import BB.Unit
      iex> ~u(5 meter_per_second)
      %BB.Unit{name: "meter-per-second", value: 5}
      iex> BB.Unit.convert!(~u(90 degree), :radian).value
      1.5707963267948966

  Quantities are for people: in a robot's declaration, in options and in parameters. Messages and code that computes use plain
  floats in SI units, which `to_si/1` gives.

  ## Names

  The sigil and the functions take a name as an atom or a string, with `_` or `-` between its words. The units are

  #{Enum.map_join(BB.Unit.Name.metric(), ", ", &"`#{&1}`")}

  with or without an SI prefix (`milli`, `kilo`, …), and

  #{Enum.map_join(BB.Unit.Name.known() -- BB.Unit.Name.metric(), ", ", &"`#{&1}`")}.

  They combine: `newton_meter` is a product, `meter_per_second` a quotient (everything behind `per` divides), `square_meter`,
  `cubic_meter`, `meter_per_square_second` and `meter_per_second_squared` are powers. What has the same dimensions can be
  converted and compared, whatever its name: a `volt_ampere` is a `watt`. An angle counts as a dimension of its own, so that
  `radian_per_second` is no `hertz`.

  A temperature in `celsius` or `fahrenheit` has its zero where its scale has it. In a rate or a product, as
  `celsius_per_second`, it is a difference.
  """

  alias BB.Unit.Name

  @enforce_keys [:name, :value]
  defstruct [:name, :value]

  @type t :: %__MODULE__{name: String.t(), value: number()}

  @typedoc "The name of a unit, as `:meter_per_second` or `\"meter-per-second\"`."
  @type name :: atom() | String.t()

  @doc """
  A quantity, written down and checked when compiled.

  A unit that does not exist is a `CompileError`.
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
      "~u takes a number and a unit, as ~u(5 meter_per_second), without interpolation or modifiers; " <>
        "BB.Unit.new!/2 takes values that are known later"
    )
  end

  @doc """
  A quantity of a value and a name, in either order: `{:ok, unit}` or `{:error, exception}`.

      iex> BB.Unit.new(100, :hertz)
      {:ok, %BB.Unit{name: "hertz", value: 100}}
      iex> {:error, error} = BB.Unit.new(1, :metre)
      iex> error.message
      ~s(unknown unit "metre"; close ones are meter, ampere)
  """
  @spec new(number(), name()) :: {:ok, t()} | {:error, Exception.t()}
  @spec new(name(), number()) :: {:ok, t()} | {:error, Exception.t()}
  def new(value, name) when is_number(value) do
    with {:ok, name, _meaning} <- meaning(name), do: {:ok, %__MODULE__{name: name, value: value}}
  end

  def new(name, value) when is_number(value), do: new(value, name)

  def new(value, name) do
    raise ArgumentError,
          "a quantity has a number and the name of a unit, got: #{inspect(value)} and #{inspect(name)}"
  end

  @doc "Like `new/2`, but returns the quantity itself or raises `ArgumentError`."
  @spec new!(number(), name()) :: t()
  @spec new!(name(), number()) :: t()
  def new!(value, name), do: bang(new(value, name))

  @doc """
  Reads a quantity from a text such as `"5 meter_per_second"`: `{:ok, unit}` or `{:error, exception}`.

      iex> BB.Unit.parse("-1.5 newton-meter")
      {:ok, %BB.Unit{name: "newton-meter", value: -1.5}}
  """
  @spec parse(String.t()) :: {:ok, t()} | {:error, Exception.t()}
  def parse(text) when is_binary(text) do
    with [number, name] <- String.split(text),
         {:ok, value} <- parse_number(String.replace(number, ~r/(?<=\d)_(?=\d)/, "")) do
      new(value, name)
    else
      _ -> error("expected a number and a unit, as 5 meter_per_second, got: #{inspect(text)}")
    end
  end

  @doc """
  The same quantity in another unit: `{:ok, unit}` or `{:error, exception}`.

  Whole numbers stay whole where the result is exact.

      iex> import BB.Unit
      iex> BB.Unit.convert(~u(1.5 kilohertz), :hertz)
      {:ok, %BB.Unit{name: "hertz", value: 1500.0}}
      iex> BB.Unit.convert(~u(100 celsius), :fahrenheit)
      {:ok, %BB.Unit{name: "fahrenheit", value: 212}}
      iex> {:error, error} = BB.Unit.convert(~u(1 meter), :second)
      iex> error.message
      "1 meter cannot be converted to second: the one is a length, the other is a time"
  """
  @spec convert(t(), name()) :: {:ok, t()} | {:error, Exception.t()}
  def convert(%__MODULE__{} = unit, name) do
    with {:ok, _, from} <- meaning(unit.name),
         {:ok, name, to} <- meaning(name) do
      if from.dimensions == to.dimensions,
        do: {:ok, %__MODULE__{name: name, value: convert_value(unit.value, from, to)}},
        else: error(incompatible(unit, name, from, to))
    end
  end

  @doc "Like `convert/2`, but returns the quantity itself or raises `ArgumentError`."
  @spec convert!(t(), name()) :: t()
  def convert!(unit, name), do: bang(convert(unit, name))

  @doc """
  The plain number in SI units, a float: metres, kilograms, seconds, amperes, kelvins, radians and what is made of them, so
  hertz, newtons, newton metres, volts, ohms, radians per second, ….

      iex> import BB.Unit
      iex> {BB.Unit.to_si(~u(180 degree)), BB.Unit.to_si(~u(20 millisecond)), BB.Unit.to_si(~u(0 celsius))}
      {3.141592653589793, 0.02, 273.15}
  """
  @spec to_si(t()) :: float()
  def to_si(%__MODULE__{} = unit) do
    {:ok, _, from} = meaning(unit.name)
    convert_value(unit.value, from, %Name{}) / 1
  end

  @doc """
  Which of two quantities is greater: `:lt`, `:eq` or `:gt`, so that `Enum.sort(units, BB.Unit)` works.

  Raises `ArgumentError` when they are not of the same kind.

      iex> import BB.Unit
      iex> BB.Unit.compare(~u(999 meter), ~u(1 kilometer))
      :lt
  """
  @spec compare(t(), t()) :: :lt | :eq | :gt
  def compare(%__MODULE__{} = a, %__MODULE__{} = b) do
    b = convert!(b, a.name)

    cond do
      a.value < b.value -> :lt
      a.value > b.value -> :gt
      true -> :eq
    end
  end

  @doc """
  Whether two quantities, or names of units, are of the same kind, so that each can be converted to the other.

      iex> import BB.Unit
      iex> {BB.Unit.compatible?(~u(1 inch), :meter), BB.Unit.compatible?(:hertz, :radian_per_second)}
      {true, false}
  """
  @spec compatible?(t() | name(), t() | name()) :: boolean()
  def compatible?(a, b), do: dimensions!(a) == dimensions!(b)

  @doc """
  The quantity in words.

      iex> import BB.Unit
      iex> BB.Unit.to_string!(~u(5 meter_per_second))
      "5 meter per second"
  """
  @spec to_string!(t()) :: String.t()
  def to_string!(%__MODULE__{} = unit),
    do: "#{unit.value} #{words(unit.name)}"

  @doc """
  The type of an option of `BB.Options` that is a quantity: a number in the unit `name`, or a quantity of the same kind, which becomes
  such a number. It is from `least` to `most`.

      iex> schema = [rate: [type: BB.Unit.option(:hertz, 4, 1000)]]
      iex> BB.Options.validate([rate: BB.Unit.new!(0.5, :kilohertz)], schema)
      {:ok, [rate: 500.0]}
      iex> {:error, error} = BB.Options.validate([rate: 3], schema)
      iex> Exception.message(error)
      "invalid value for :rate option: expected a frequency of 4 to 1000 hertz, as a number or a unit, got: 3"
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
         "expected #{kind(dimensions!(name))} of #{least} to #{most} #{words(name)}, as a number or a unit, got: #{inspect(value)}"}
    end
  end

  defp number_in(%__MODULE__{} = unit, name) do
    with {:ok, unit} <- convert(unit, name), do: {:ok, unit.value}
  end

  defp number_in(number, _name) when is_number(number), do: {:ok, number}
  defp number_in(_other, _name), do: :error

  defp words(name), do: name |> Name.normalise() |> String.replace("-", " ")

  defp parse_number(text) do
    case {Integer.parse(text), Float.parse(text)} do
      {{integer, ""}, _} -> {:ok, integer}
      {_, {float, ""}} -> {:ok, float}
      _ -> :error
    end
  end

  defp meaning(name) do
    name = Name.normalise(name)

    case Name.parse(name) do
      {:ok, meaning} -> {:ok, name, meaning}
      {:error, message} -> error(message)
    end
  end

  defp dimensions!(%__MODULE__{name: name}), do: dimensions!(name)
  defp dimensions!(name), do: elem(bang_meaning(meaning(name)), 2).dimensions

  defp bang_meaning({:ok, _, _} = meaning), do: meaning
  defp bang_meaning({:error, error}), do: raise(error)

  defp bang({:ok, unit}), do: unit
  defp bang({:error, error}), do: raise(error)

  defp error(message), do: {:error, ArgumentError.exception(message)}

  defp convert_value(value, from, to) do
    ratio = Name.divide(from.ratio, to.ratio)
    shift = from.offset |> Name.subtract(to.offset) |> Name.divide(to.ratio)
    apply_affine(value, ratio, from.pi - to.pi, shift)
  end

  defp apply_affine(value, ratio, 0, shift) when is_integer(value),
    do: {value, 1} |> Name.multiply(ratio) |> Name.add(shift) |> quotient()

  defp apply_affine(value, {n, d}, pi, shift),
    do: value * n / d * :math.pow(:math.pi(), pi) + quotient(shift)

  defp quotient({n, 1}), do: n
  defp quotient({n, d}), do: n / d

  defp incompatible(unit, name, from, to) do
    "#{to_string!(unit)} cannot be converted to #{name}: " <>
      "the one is #{kind(from.dimensions)}, the other is #{kind(to.dimensions)}"
  end

  @kinds [
    {:meter, "a length"},
    {:square_meter, "an area"},
    {:cubic_meter, "a volume"},
    {:radian, "an angle"},
    {:second, "a time"},
    {:hertz, "a frequency"},
    {:gram, "a mass"},
    {:newton, "a force"},
    {:newton_meter, "a torque or an energy"},
    {:pascal, "a pressure"},
    {:watt, "a power"},
    {:volt, "a voltage"},
    {:ampere, "a current"},
    {:ohm, "a resistance"},
    {:coulomb, "a charge"},
    {:kelvin, "a temperature"},
    {:meter_per_second, "a speed"},
    {:meter_per_square_second, "an acceleration"},
    {:radian_per_second, "an angular speed"},
    {:radian_per_square_second, "an angular acceleration"}
  ]

  defp kind(dimensions) when dimensions == %{}, do: "a plain number"

  defp kind(dimensions) do
    kinds = for {name, kind} <- @kinds, do: {dimensions!(name), kind}

    case List.keyfind(kinds, dimensions, 0) do
      {_, kind} -> kind
      nil -> "of another kind"
    end
  end

  defp compile_error(env, text),
    do: raise(CompileError, file: env.file, line: env.line, description: text)
end

defimpl String.Chars, for: BB.Unit do
  defdelegate to_string(unit), to: BB.Unit, as: :to_string!
end

defimpl Inspect, for: BB.Unit do
  def inspect(unit, _opts), do: "~u(#{unit.value} #{String.replace(unit.name, "-", "_")})"
end
