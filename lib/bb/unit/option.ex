defmodule BB.Unit.Option do
  @moduledoc """
  The type of an option that is a quantity, for the schemas of `BB.Options`. Use it for the
  options of drivers that a robot gives with their units:

      defmodule MyRobot.Thermometer do
        use BB.Sensor

        import BB.Unit
        import BB.Unit.Option

        @impl BB.Sensor
        def options_schema do
          BB.Options.new!(
            rate: [
              type: unit_type(compatible: :hertz, min: ~u(1 hertz), max: ~u(10 hertz)),
              default: ~u(4 hertz)
            ]
          )
        end
      end

  The value of such an option is a `BB.Unit`, as it was given: 5000 millihertz stay 5000
  millihertz. `BB.Loop`, `BB.Unit.convert!/2` and `BB.Robot.Units` take it from there. An option
  that becomes a plain number has the type `BB.Unit.option/3`.
  """

  alias BB.{Options, Unit}
  alias BB.Options.ValidationError
  alias BB.Parameter.Reference

  @bounds [:min, :max, :eq]

  @bound {:or, [{:struct, Unit}, {:struct, Reference}]}

  @schema Options.new!(
            compatible: [
              type: {:or, [:atom, :string]},
              doc: "The name of a unit. The option's values can be converted to it."
            ],
            min: [type: @bound, doc: "The least value: a quantity, or a reference."],
            max: [type: @bound, doc: "The greatest value."],
            eq: [type: @bound, doc: "The only value."]
          )

  @type option ::
          {:compatible, Unit.name()}
          | {:min, Unit.t() | Reference.t()}
          | {:max, Unit.t() | Reference.t()}
          | {:eq, Unit.t() | Reference.t()}

  @type options :: [option()]

  @doc """
  Returns the type of an option that is a quantity.

      iex> import BB.Unit.Option
      iex> schema = [rate: [type: unit_type(compatible: :hertz, min: BB.Unit.new!(1, :hertz))]]
      iex> {:ok, [rate: rate]} = BB.Options.validate([rate: BB.Unit.new!(2, :kilohertz)], schema)
      iex> rate
      %BB.Unit{name: "kilohertz", value: 2}
      iex> {:error, error} = BB.Options.validate([rate: BB.Unit.new!(0.5, :hertz)], schema)
      iex> Exception.message(error)
      "invalid value for :rate option: expected at least 1 hertz, got: 0.5 hertz"

  The options are:

  #{Options.docs(@schema)}
  Wrong options raise: a `BB.Options.ValidationError`, or the exception of an unknown unit.
  """
  @spec unit_type(options()) :: {:custom, module(), :validate, [options()]}
  def unit_type(options \\ []) do
    _ = Options.validate!(options, @schema)
    check_unit!(options[:compatible])
    check_bounds!(options)
    {:custom, __MODULE__, :validate, [options]}
  end

  defp check_unit!(nil), do: :ok

  defp check_unit!(name) do
    case Unit.validate_unit(name) do
      {:ok, _name} -> :ok
      {:error, error} -> raise error
    end
  end

  defp check_bounds!(options) do
    kind = kind(options)

    Enum.each(Keyword.take(options, @bounds), fn
      {key, %Unit{} = bound} -> Unit.compatible?(bound, kind) || raise_bound(key, bound, kind)
      {_key, %Reference{}} -> :ok
    end)
  end

  defp raise_bound(key, bound, kind) do
    raise ValidationError,
      key: key,
      value: bound,
      message:
        "invalid value for #{inspect(key)} option: expected a unit that is compatible with " <>
          "`#{show_kind(kind)}`, got: #{show(bound)}"
  end

  # The kind is given by its unit or by the first of the bounds.
  defp kind(options),
    do: options[:compatible] || Enum.find_value(@bounds, &quantity(options[&1]))

  defp quantity(%Unit{} = bound), do: bound
  defp quantity(_reference), do: nil

  @doc """
  Checks a value of the type: `{:ok, value}`, or `{:error, message}`.

  The value of an option may be a reference to a parameter. It becomes one that expects the unit
  of the type. A bound that is a reference is not checked.

      iex> BB.Unit.Option.validate(BB.Unit.new!(100, :centimeter), compatible: :meter)
      {:ok, %BB.Unit{name: "centimeter", value: 100}}
      iex> BB.Unit.Option.validate("not a unit")
      {:error, "Value `\\"not a unit\\"` is not a `BB.Unit` struct"}
      iex> BB.Unit.Option.validate(BB.Unit.new!(90, :degree), compatible: :meter)
      {:error, "The unit `degree` is not compatible with `meter`"}
  """
  @spec validate(term(), options()) :: {:ok, Unit.t() | Reference.t()} | {:error, String.t()}
  def validate(value, options \\ [])

  def validate(%Reference{} = reference, options),
    do: {:ok, %{reference | expected_unit_type: options[:compatible]}}

  def validate(%Unit{value: value} = unit, options) when is_number(value) do
    with :ok <- check_name(unit),
         :ok <- check_kind(unit, kind(options)),
         :ok <- check_bound(:min, unit, options[:min]),
         :ok <- check_bound(:max, unit, options[:max]),
         :ok <- check_bound(:eq, unit, options[:eq]),
         do: {:ok, unit}
  end

  def validate(value, _options),
    do: {:error, "Value `#{inspect(value)}` is not a `BB.Unit` struct"}

  # A struct that was written out may have any name.
  defp check_name(unit) do
    with {:error, error} <- Unit.validate_unit(unit.name),
         do: {:error, Exception.message(error)},
         else: (_ok -> :ok)
  end

  defp check_kind(_unit, nil), do: :ok

  defp check_kind(unit, kind) do
    if Unit.compatible?(unit, kind),
      do: :ok,
      else: {:error, "The unit `#{unit.name}` is not compatible with `#{show_kind(kind)}`"}
  end

  defp check_bound(which, unit, %Unit{} = bound) do
    if within?(which, Unit.compare!(unit, bound)),
      do: :ok,
      else: {:error, "expected #{limit(which)}#{show(bound)}, got: #{show(unit)}"}
  end

  defp check_bound(_which, _unit, _reference), do: :ok

  defp within?(:min, order), do: order != :lt
  defp within?(:max, order), do: order != :gt
  defp within?(:eq, order), do: order == :eq

  defp limit(:min), do: "at least "
  defp limit(:max), do: "at most "
  defp limit(:eq), do: ""

  defp show_kind(%Unit{name: name}), do: name
  defp show_kind(name), do: name

  defp show(unit), do: Unit.to_string!(unit)
end
