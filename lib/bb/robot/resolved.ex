defmodule BB.Robot.Resolved do
  @moduledoc """
  Puts the values of parameters into a robot's description, and converts quantities to SI.
  `BB.Robot.resolve/2` and `BB.Robot.Builder` use it. Pure.

      iex> import BB.Unit
      iex> BB.Robot.Resolved.to_si(~u(10 centimeter))
      0.1
      iex> BB.Robot.Resolved.to_si(%BB.Parameter.Reference{path: [:height]})
      nil
  """

  alias BB.Parameter.Reference
  alias BB.{Robot, Unit}

  @places %{
    link: :links,
    joint: :joints,
    sensor: :sensors,
    actuator: :actuators
  }

  # The places of a joint's origin and of a link's centre of mass within a triple.
  @indices %{x: 0, y: 1, z: 2, roll: 0, pitch: 1, yaw: 2}

  @doc "Puts the values of parameters into the places that follow them."
  @spec resolve(Robot.t(), (BB.Parameter.path() -> term())) :: Robot.t()
  def resolve(%Robot{param_subscriptions: none} = robot, _fetch) when none == %{}, do: robot

  def resolve(%Robot{} = robot, fetch) do
    for {path, places} <- robot.param_subscriptions,
        value = fetch.(path),
        value != nil,
        place <- places,
        reduce: resolve_axes(robot, fetch),
        do: (robot -> put(robot, place, value))
  end

  defp put(robot, {_part, _name, [:axis, _field]}, _value), do: robot

  defp put(robot, {part, name, fields}, value) do
    keys = Enum.map([@places[part], name] ++ fields, &access/1)
    put_in(robot, replace_index(keys, fields), to_si(value))
  end

  defp access(key), do: Access.key!(key)

  # `[:origin, :z]` is an element of the origin's position.
  defp replace_index(keys, [:origin, field]) do
    triple = if field in [:x, :y, :z], do: :position, else: :orientation
    List.delete_at(keys, -1) ++ [Access.key!(triple), Access.elem(@indices[field])]
  end

  defp replace_index(keys, [:center_of_mass, field]),
    do: List.delete_at(keys, -1) ++ [Access.elem(@indices[field])]

  defp replace_index(keys, _fields), do: keys

  defp resolve_axes(robot, fetch) do
    for {name, declared} <- robot.declared_axes, reduce: robot do
      robot -> put_in(robot.joints[name].axis, axis(declared, fetch))
    end
  end

  @doc """
  Returns the direction of an axis as a unit vector `{x, y, z}`.

  The axis is z turned by `Rx(roll)·Ry(pitch)·Rz(yaw)`, or has the direction of its `x`, `y`, `z`.
  Returns `nil` while one of its fields has no value, and for a direction of no length.
  """
  @spec axis(map(), (BB.Parameter.path() -> term())) :: {float(), float(), float()} | nil
  def axis(declared, fetch \\ fn _path -> nil end) do
    fields = [:x, :y, :z, :roll, :pitch, :yaw]
    values = Map.new(fields, &{&1, axis_value(Map.get(declared, &1), fetch)})

    cond do
      :unknown in Map.values(values) -> nil
      values.x || values.y || values.z -> direction(values)
      true -> turned(values)
    end
  end

  defp axis_value(nil, _fetch), do: nil
  defp axis_value(%Reference{path: path}, fetch), do: to_si(fetch.(path)) || :unknown
  defp axis_value(value, _fetch), do: to_si(value)

  defp direction(%{x: x, y: y, z: z}) do
    {x, y, z} = {x || 0.0, y || 0.0, z || 0.0}
    length = :math.sqrt(x * x + y * y + z * z)
    if length > 0.0, do: {x / length, y / length, z / length}
  end

  # yaw turns z about itself. The subtraction makes no negative zero.
  defp turned(%{roll: roll, pitch: pitch}) do
    {:math.sin(pitch), 0.0 - :math.sin(roll) * :math.cos(pitch),
     :math.cos(roll) * :math.cos(pitch)}
  end

  @doc """
  Converts a declared value to SI: a quantity and a number to a float, a reference to `nil`.
  Other values do not change.
  """
  @spec to_si(term()) :: term()
  def to_si(%Unit{} = quantity), do: Unit.to_si(quantity)
  def to_si(%Reference{}), do: nil
  def to_si(number) when is_number(number), do: number / 1
  def to_si(other), do: other

  @doc "Converts the fields of a declared entity to SI, as a map."
  @spec numbers(struct()) :: %{atom() => term()}
  def numbers(declared),
    do: declared |> Map.from_struct() |> Map.new(fn {key, it} -> {key, to_si(it)} end)
end
