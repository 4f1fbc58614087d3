defmodule BB.Dsl.Grammar do
  @moduledoc """
  What may stand where in a robot's declaration: for each entity its fields, as a schema of `BB.Options`, and the entities
  that may stand inside it.
  """

  @kinds [:robot, :settings, :sensors, :topology, :link, :joint, :sensor] ++
           [:origin, :axis, :limit, :dynamics]

  @joint_types [:revolute, :continuous, :prismatic, :fixed]

  @doc "The types of joints."
  def joint_types, do: @joint_types

  @doc "The entities that may stand inside one of `kind`."
  @spec entities(atom()) :: [atom()]
  def entities(:robot), do: [:settings, :sensors, :topology]
  def entities(:sensors), do: [:sensor]
  def entities(:topology), do: [:link]
  def entities(:link), do: [:sensor, :joint]
  def entities(:joint), do: [:origin, :axis, :limit, :dynamics, :sensor, :link]
  def entities(_kind), do: []

  @doc "The entities that have a name."
  def named?(kind), do: kind in [:link, :joint, :sensor]

  @doc "The fields of an entity of `kind`."
  @spec fields(atom()) :: BB.Options.schema()
  def fields(:settings), do: [name: [type: :atom]]
  def fields(:joint), do: [type: [type: {:in, @joint_types}]]

  def fields(:sensor) do
    [
      required: [type: :boolean],
      retain: [type: :boolean],
      max_silence: [type: {:custom, __MODULE__, :check_duration, []}]
    ]
  end

  def fields(:origin) do
    for(field <- [:x, :y, :z], do: {field, [type: a_length()]}) ++
      for field <- [:roll, :pitch, :yaw], do: {field, [type: an_angle()]}
  end

  def fields(:axis), do: for(field <- [:x, :y, :z], do: {field, [type: :number]})

  def fields(:limit) do
    [
      lower: [type: {:struct, BB.Unit}],
      upper: [type: {:struct, BB.Unit}],
      effort: [type: {:struct, BB.Unit}],
      velocity: [type: {:struct, BB.Unit}]
    ]
  end

  def fields(:dynamics), do: [damping: [type: :number], friction: [type: :number]]
  def fields(_kind), do: []

  @doc "The fields of a limit for a joint of `type`: their kind of unit depends on how the joint moves."
  @spec limit_fields(atom()) :: BB.Options.schema()
  def limit_fields(:prismatic) do
    [
      lower: [type: a_length()],
      upper: [type: a_length()],
      effort: [type: unit(:newton, "a force such as ~u(10 newton)")],
      velocity: [type: unit(:meter_per_second, "a speed such as ~u(0.5 meter_per_second)")]
    ]
  end

  def limit_fields(_turning) do
    [
      lower: [type: an_angle()],
      upper: [type: an_angle()],
      effort: [type: unit(:newton_meter, "a torque such as ~u(10 newton_meter)")],
      velocity: [
        type: unit(:radian_per_second, "an angular speed such as ~u(60 degree_per_second)")
      ]
    ]
  end

  @doc "All words that may stand inside an entity of `kind`."
  @spec words(atom()) :: [atom()]
  def words(kind), do: Keyword.keys(fields(kind)) ++ entities(kind)

  @doc "The entities in which a word may stand."
  @spec homes(atom()) :: [atom()]
  def homes(word), do: Enum.filter(@kinds, &(word in words(&1)))

  @doc false
  def check_unit(%BB.Unit{} = value, unit, expected) do
    if BB.Unit.compatible?(value, unit), do: {:ok, value}, else: refuse(value, expected)
  end

  def check_unit(value, _unit, expected), do: refuse(value, expected)

  @doc false
  def check_duration(value) do
    expected = "a time above zero such as ~u(100 millisecond)"

    with {:ok, duration} <- check_unit(value, :second, expected) do
      if duration.value > 0, do: {:ok, duration}, else: refuse(value, expected)
    end
  end

  defp refuse(%BB.Unit{} = value, expected),
    do: {:error, "expected #{expected}, got: #{BB.Unit.to_string!(value)}"}

  defp refuse(value, expected), do: {:error, "expected #{expected}, got: #{inspect(value)}"}

  defp unit(unit, expected), do: {:custom, __MODULE__, :check_unit, [unit, expected]}
  defp a_length, do: unit(:meter, "a length such as ~u(0.1 meter)")
  defp an_angle, do: unit(:radian, "an angle such as ~u(90 degree)")
end
