defmodule BB.Robot.Units do
  @moduledoc """
  Converts quantities to floats in SI units. Use it where a driver or a robot's geometry needs
  plain numbers:

      iex> import BB.Unit
      iex> BB.Robot.Units.to_meters(~u(100 centimeter))
      1.0
      iex> BB.Robot.Units.to_radians(~u(180 degree))
      3.141592653589793

  Each function takes a `BB.Unit`. A quantity of another kind raises `ArgumentError`, and anything
  that is no quantity raises `FunctionClauseError`. The functions whose names end in `_or_nil`
  return `nil` for `nil`.
  """

  alias BB.Unit

  # A Decimal is the value of a quantity that the library for it has made.
  @compile {:no_warn_undefined, Decimal}

  conversions = [
    {:to_meters, "meter", "a length in metres"},
    {:to_radians, "radian", "an angle in radians"},
    {:to_kilograms, "kilogram", "a mass in kilograms"},
    {:to_kilogram_square_meters, "kilogram-square-meter", "a moment of inertia in kg·m²"},
    {:to_newtons, "newton", "a force in newtons"},
    {:to_newton_meters, "newton-meter", "a torque in newton metres"},
    {:to_meters_per_second, "meter-per-second", "a speed in m/s"},
    {:to_radians_per_second, "radian-per-second", "an angular speed in rad/s"},
    {:to_meters_per_square_second, "meter-per-square-second", "an acceleration in m/s²"},
    {:to_radians_per_square_second, "radian-per-square-second",
     "an angular acceleration in rad/s²"},
    {:to_linear_damping, "newton-second-per-meter", "a linear damping in N·s/m"},
    {:to_rotational_damping, "newton-meter-second-per-radian",
     "a rotational damping in N·m·s/rad"}
  ]

  for {name, unit, description} <- conversions do
    or_nil = :"#{name}_or_nil"

    @doc "Returns #{description}, as a float."
    @spec unquote(name)(Unit.t()) :: float()
    def unquote(name)(%Unit{} = quantity), do: convert(quantity, unquote(unit))

    @doc "Returns #{description}, as a float, or `nil` for `nil`."
    @spec unquote(or_nil)(Unit.t() | nil) :: float() | nil
    def unquote(or_nil)(nil), do: nil
    def unquote(or_nil)(quantity), do: unquote(name)(quantity)
  end

  @doc "Returns a force in newtons, as a float. The same as `to_newtons/1`."
  @spec to_newton(Unit.t()) :: float()
  def to_newton(%Unit{} = quantity), do: to_newtons(quantity)

  @doc """
  Returns the value of a quantity as a float, in the unit that it has.

      iex> BB.Robot.Units.extract_float(BB.Unit.new!(5, :kilohertz))
      5.0
  """
  @spec extract_float(Unit.t()) :: float()
  def extract_float(%Unit{value: value}) when is_number(value), do: value / 1
  def extract_float(%Unit{value: %{__struct__: Decimal} = value}), do: Decimal.to_float(value)

  defp convert(quantity, unit), do: quantity |> Unit.convert!(unit) |> extract_float()
end
