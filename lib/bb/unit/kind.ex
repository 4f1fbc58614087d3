defmodule BB.Unit.Kind do
  @moduledoc false
  # Names the kind of a quantity, such as "a length", for error messages.

  alias BB.Unit.Name

  @kinds [
    {"meter", "a length"},
    {"square-meter", "an area"},
    {"cubic-meter", "a volume"},
    {"radian", "an angle"},
    {"second", "a time"},
    {"hertz", "a frequency"},
    {"gram", "a mass"},
    {"kilogram-square-meter", "a moment of inertia"},
    {"newton", "a force"},
    {"newton-meter", "a torque or an energy"},
    {"newton-second-per-meter", "a linear damping"},
    {"newton-meter-second-per-radian", "a rotational damping"},
    {"pascal", "a pressure"},
    {"watt", "a power"},
    {"volt", "a voltage"},
    {"ampere", "a current"},
    {"ohm", "a resistance"},
    {"coulomb", "a charge"},
    {"kelvin", "a temperature"},
    {"meter-per-second", "a speed"},
    {"meter-per-square-second", "an acceleration"},
    {"radian-per-second", "an angular speed"},
    {"radian-per-square-second", "an angular acceleration"}
  ]

  @doc "Returns the kind of quantities with these dimensions, with its article."
  def describe(dimensions) when dimensions == %{}, do: "a plain number"

  def describe(dimensions) do
    Enum.find_value(@kinds, "of other dimensions", fn {name, kind} ->
      {:ok, meaning} = Name.parse(name)
      if meaning.dimensions == dimensions, do: kind
    end)
  end
end
