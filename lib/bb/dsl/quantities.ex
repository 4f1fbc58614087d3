defmodule BB.Dsl.Quantities do
  @moduledoc """
  Checks the quantities of a robot's declaration, and has the units of a joint's fields, which
  depend on how the joint moves. Pure. `BB.Dsl.Rules` uses it.

      iex> import BB.Unit
      iex> BB.Dsl.Quantities.check(:upper, ~u(90 degree), :revolute)
      :ok
      iex> BB.Dsl.Quantities.check(:upper, ~u(1 meter), :revolute)
      {:error,
       "Expected unit 1 meter of :upper to be compatible with degree: " <>
         "`meter` is not compatible with a `revolute` joint"}
  """

  alias BB.Unit

  # Each field: its unit, and the unit in words.
  @turning %{
    lower: {:radian, "degree"},
    upper: {:radian, "degree"},
    effort: {:newton_meter, "newton meter"},
    velocity: {:radian_per_second, "radian per second"},
    acceleration: {:radian_per_square_second, "radian per square second"},
    damping: {:newton_meter_second_per_radian, "newton meter second per degree"},
    friction: {:newton_meter, "newton meter"},
    offset: {:radian, "degree"}
  }

  @sliding %{
    lower: {:meter, "meter"},
    upper: {:meter, "meter"},
    effort: {:newton, "newton"},
    velocity: {:meter_per_second, "meter per second"},
    acceleration: {:meter_per_square_second, "meter per square second"},
    damping: {:newton_second_per_meter, "newton second per meter"},
    friction: {:newton, "newton"},
    offset: {:meter, "meter"}
  }

  @doc """
  Checks that a quantity has the unit of a field at a joint of `type`. A value that is no
  quantity, and a field without a unit at that joint, are right.
  """
  @spec check(atom(), term(), atom()) :: :ok | {:error, String.t()}
  def check(field, %Unit{} = value, type) do
    case type |> units() |> Map.fetch(field) do
      {:ok, {unit, words}} -> check_at_joint(field, value, unit, words, type)
      :error -> :ok
    end
  end

  def check(_field, _value, _type), do: :ok

  defp check_at_joint(field, value, unit, words, type) do
    if Unit.compatible?(value, unit) do
      :ok
    else
      {:error,
       """
       Expected unit #{Unit.to_string!(value)} of #{inspect(field)} to be compatible with \
       #{words}: `#{value.name}` is not compatible with a `#{type}` joint\
       """}
    end
  end

  defp units(type) when type in [:revolute, :continuous], do: @turning
  defp units(type) when type in [:prismatic, :planar], do: @sliding
  defp units(_type), do: %{}

  @doc false
  def check_quantity(%Unit{} = value), do: {:ok, value}

  def check_quantity(value),
    do: {:error, "expected a quantity such as ~u(90 degree), got: #{inspect(value)}"}

  @doc false
  def check_unit(%Unit{} = value, unit, example) do
    if Unit.compatible?(value, unit),
      do: {:ok, value},
      else: {:error, "expected #{kind(unit)} such as #{example}, got: #{Unit.to_string!(value)}"}
  end

  def check_unit(value, unit, example),
    do: {:error, "expected #{kind(unit)} such as #{example}, got: #{inspect(value)}"}

  @doc false
  def check_resistance(value) when is_number(value), do: {:ok, value}
  def check_resistance(%Unit{} = value), do: {:ok, value}

  def check_resistance(value) do
    {:error,
     "expected a quantity such as ~u(0.1 newton_meter), or a number in SI units, got: " <>
       inspect(value)}
  end

  @doc false
  def check_reduction(value) when is_number(value) and value != 0, do: {:ok, value}

  def check_reduction(value) do
    {:error,
     "expected a number other than zero, motor turns per joint turn, got: #{inspect(value)}"}
  end

  @doc false
  def check_duration(value) do
    with {:ok, duration} <- check_unit(value, :second, "~u(100 millisecond)") do
      if duration.value > 0,
        do: {:ok, duration},
        else: {:error, "expected a time above zero, got: #{Unit.to_string!(duration)}"}
    end
  end

  defp kind(:meter), do: "a length"
  defp kind(:radian), do: "an angle"
  defp kind(:second), do: "a time above zero"
  defp kind(:kilogram), do: "a mass"
  defp kind(:kilogram_square_meter), do: "a moment of inertia"
end
