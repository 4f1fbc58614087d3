defmodule BB.Dsl.Grammar do
  @moduledoc """
  The grammar of a robot's declaration: the fields of each entity, as a schema of `BB.Options`,
  and the entities that may stand inside it. Pure. The rules of `BB.Dsl` read it.

      iex> BB.Dsl.Grammar.entities(:link)
      [:sensor, :joint]
      iex> BB.Dsl.Grammar.homes(:axis)
      [:joint]
  """

  @kinds [:robot, :settings, :sensors, :controllers, :topology, :link, :joint] ++
           [:sensor, :actuator, :controller, :transmission] ++
           [:origin, :axis, :limit, :dynamics, :parameters, :group, :param] ++
           [:simulation, :i2c, :gpio, :device]

  @components [:sensor, :actuator, :controller]

  @joint_types [:revolute, :continuous, :prismatic, :fixed]

  @doc "Returns the types of joints."
  @spec joint_types() :: [atom()]
  def joint_types, do: @joint_types

  @doc "Returns the entities that may stand inside an entity of `kind`."
  @spec entities(atom()) :: [atom()]
  def entities(:robot),
    do: [:settings, :parameters, :sensors, :controllers, :topology, :simulation]

  def entities(:simulation), do: [:i2c, :gpio]
  def entities(kind) when kind in [:i2c, :gpio], do: [:device]
  def entities(kind) when kind in [:parameters, :group], do: [:param, :group]
  def entities(:sensors), do: [:sensor]
  def entities(:controllers), do: [:controller]
  def entities(:topology), do: [:link]
  def entities(:link), do: [:sensor, :joint]
  def entities(:joint), do: [:origin, :axis, :limit, :dynamics, :sensor, :actuator, :link]
  def entities(kind) when kind in [:sensor, :actuator], do: [:transmission]
  def entities(_kind), do: []

  @doc "Tells whether entities of `kind` have a name."
  @spec named?(atom()) :: boolean()
  def named?(kind),
    do: kind in [:link, :joint, :param, :group, :i2c, :gpio, :device | @components]

  @doc "Tells whether an entity of `kind` may be declared without its name."
  @spec nameless?(atom()) :: boolean()
  def nameless?(kind), do: kind in [:link, :joint]

  @doc "Returns the kinds of components."
  @spec components() :: [atom()]
  def components, do: @components

  @doc "Tells whether the fields of an entity of `kind` may refer to a parameter."
  @spec follows?(atom()) :: boolean()
  def follows?(kind), do: kind in [:origin, :axis, :limit, :transmission]

  @doc "Returns the fields of an entity of `kind`."
  @spec fields(atom()) :: BB.Options.schema()
  def fields(:settings) do
    [
      name: [type: :atom],
      topic_prefix: [type: {:custom, BB.Topic, :check_prefix, []}],
      parameter_store: [type: {:or, [:module, {:tuple, [:module, :keyword_list]}]}],
      registry_module: [type: :module],
      registry_options: [type: :keyword_list],
      supervisor_module: [type: :module]
    ]
  end

  def fields(:param) do
    [doc: [type: :string]] ++
      for field <- [:type, :default, :min, :max], do: {field, [type: :any]}
  end

  def fields(:joint), do: [type: [type: {:in, @joint_types}]]

  def fields(:sensor) do
    [
      required: [type: :boolean],
      retain: [type: :boolean],
      max_silence: [type: {:custom, __MODULE__, :check_duration, []}]
    ]
  end

  def fields(kind) when kind in [:actuator, :controller], do: [required: [type: :boolean]]

  def fields(:transmission) do
    [
      reduction: [type: {:custom, __MODULE__, :check_reduction, []}],
      offset: [type: {:struct, BB.Unit}],
      reversed?: [type: :boolean]
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

  def fields(:i2c), do: [clock_hz: [type: :pos_integer]]

  def fields(:gpio) do
    [
      lines: [type: :pos_integer],
      label: [type: :string],
      labels: [type: {:map, :non_neg_integer, :string}],
      timestamp_offset_ns: [type: :integer]
    ]
  end

  def fields(:dynamics), do: [damping: [type: :number], friction: [type: :number]]
  def fields(_kind), do: []

  @doc """
  Returns the fields of a limit for a joint of `type`. Their units depend on the movement of the
  joint.
  """
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

  @doc """
  Returns the fields of a transmission at a joint of `type`. The offset has the unit of the joint.
  """
  @spec transmission_fields(atom()) :: BB.Options.schema()
  def transmission_fields(type) do
    offset = if type == :prismatic, do: a_length(), else: an_angle()
    Keyword.put(fields(:transmission), :offset, type: offset)
  end

  @doc "Returns all words that may stand inside an entity of `kind`."
  @spec words(atom()) :: [atom()]
  def words(kind), do: Keyword.keys(fields(kind)) ++ entities(kind)

  @doc "Returns the kinds of entities in which a word may stand."
  @spec homes(atom()) :: [atom()]
  def homes(word), do: Enum.filter(@kinds, &(word in words(&1)))

  @doc """
  Casts the value of one field: `{:ok, value}`, or `{:error, reason}`.

      iex> BB.Dsl.Grammar.cast(BB.Dsl.Grammar.fields(:axis), :x, "1")
      {:error, ~s(invalid value for :x option: expected number, got: "1")}
  """
  @spec cast(BB.Options.schema(), atom(), term()) :: {:ok, term()} | {:error, String.t()}
  def cast(schema, field, value) do
    case BB.Options.validate([{field, value}], Keyword.take(schema, [field])) do
      {:ok, options} -> {:ok, options[field]}
      {:error, error} -> {:error, Exception.message(error)}
    end
  end

  @doc """
  Describes a kind of entity in an error message.

      iex> BB.Dsl.Grammar.describe(:i2c)
      "a simulated I2C bus"
  """
  @spec describe(atom()) :: String.t()
  def describe(:robot), do: "the robot itself"
  def describe(:i2c), do: "a simulated I2C bus"
  def describe(:gpio), do: "a simulated chip of lines"
  def describe(:param), do: "a parameter"

  def describe(kind)
      when kind in [:settings, :parameters, :sensors, :controllers, :topology] or
             kind in [:simulation, :dynamics],
      do: "#{kind}"

  def describe(kind) when kind in [:origin, :axis, :actuator], do: "an #{kind}"
  def describe(kind), do: "a #{kind}"

  @doc false
  def check_unit(%BB.Unit{} = value, unit, expected) do
    if BB.Unit.compatible?(value, unit), do: {:ok, value}, else: unit_error(value, expected)
  end

  def check_unit(value, _unit, expected), do: unit_error(value, expected)

  @doc false
  def check_reduction(value) when is_number(value) and value > 0, do: {:ok, value}

  def check_reduction(value) do
    {:error,
     "expected a number above zero, motor turns per joint turn, got: #{inspect(value)}; " <>
       "add `reversed? true` for a motor that turns the other way"}
  end

  @doc false
  def check_duration(value) do
    expected = "a time above zero such as ~u(100 millisecond)"

    with {:ok, duration} <- check_unit(value, :second, expected) do
      if duration.value > 0, do: {:ok, duration}, else: unit_error(value, expected)
    end
  end

  defp unit_error(%BB.Unit{} = value, expected),
    do: {:error, "expected #{expected}, got: #{BB.Unit.to_string!(value)}"}

  defp unit_error(value, expected), do: {:error, "expected #{expected}, got: #{inspect(value)}"}

  defp unit(unit, expected), do: {:custom, __MODULE__, :check_unit, [unit, expected]}
  defp a_length, do: unit(:meter, "a length such as ~u(0.1 meter)")
  defp an_angle, do: unit(:radian, "an angle such as ~u(90 degree)")
end
