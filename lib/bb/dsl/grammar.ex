defmodule BB.Dsl.Grammar do
  @moduledoc """
  The grammar of a robot's declaration, in one table: which entities there are, their arguments,
  and what may stand inside each. Pure. `BB.Dsl.Fields` has the fields of each entity.

      iex> BB.Dsl.Grammar.entities(:material)
      [:color, :texture]
      iex> BB.Dsl.Grammar.homes(:axis)
      [:joint]
      iex> BB.Dsl.Grammar.arguments(:sensor)
      [name: :required, child: :required]
  """

  alias BB.Dsl.Fields

  @named [name: :required]
  @maybe_named [name: :optional]
  @component [name: :required, child: :required]

  # The shapes of a visual and a collision: one of them, in the key `geometry`.
  @geometries [:box, :cylinder, :sphere, :capsule, :mesh]
  @geometry for shape <- @geometries, do: {shape, {:one, :geometry}}

  # Each kind of entity: its arguments, the struct that BB.Dsl.Info returns (without one, the
  # entity is a section), and the entities inside it, one or many, with their key in the struct.
  @table [
    robot: {
      [],
      nil,
      for(
        section <-
          ~w(settings parameters sensors controllers commands states topology simulation)a,
        do: {section, {:many, section}}
      )
    },
    settings: {[], nil, []},
    parameters: {
      [],
      nil,
      [param: {:many, :params}, group: {:many, :groups}, bridge: {:many, :bridges}]
    },
    sensors: {[], nil, [sensor: {:many, :sensors}]},
    controllers: {[], nil, [controller: {:many, :controllers}]},
    commands: {[], nil, [command: {:many, :commands}, category: {:many, :categories}]},
    states: {[], nil, [state: {:many, :states}]},
    topology: {[], nil, [link: {:many, :links}, joint: {:many, :joints}]},
    simulation: {[], nil, [i2c: {:many, :i2c}, gpio: {:many, :gpio}]},
    link: {
      @maybe_named,
      BB.Dsl.Link,
      [
        joint: {:many, :joints},
        inertial: {:one, :inertial},
        visual: {:one, :visual},
        collision: {:many, :collisions},
        sensor: {:many, :sensors},
        estimator: {:many, :estimators}
      ]
    },
    joint: {
      @maybe_named,
      BB.Dsl.Joint,
      [
        origin: {:one, :origin},
        axis: {:one, :axis},
        limit: {:one, :limit},
        dynamics: {:one, :dynamics},
        link: {:one, :link},
        sensor: {:many, :sensors},
        actuator: {:many, :actuators}
      ]
    },
    sensor: {
      @component,
      BB.Dsl.Sensor,
      [transmission: {:one, :transmission}, estimator: {:many, :estimators}]
    },
    actuator: {@component, BB.Dsl.Actuator, [transmission: {:one, :transmission}]},
    controller: {@component, BB.Dsl.Controller, []},
    bridge: {@component, BB.Dsl.Bridge, []},
    estimator: {
      @component,
      BB.Dsl.Estimator,
      [input: {:many, :inputs}, output: {:many, :outputs}]
    },
    input: {[name: :required, path: :optional], BB.Dsl.Estimator.Input, []},
    output: {@named, BB.Dsl.Estimator.Output, []},
    transmission: {[], BB.Dsl.Transmission, []},
    origin: {[], BB.Dsl.Origin, []},
    axis: {[], BB.Dsl.Axis, []},
    limit: {[], BB.Dsl.Limit, []},
    dynamics: {[], BB.Dsl.Dynamics, []},
    inertial: {[], BB.Dsl.Inertial, [origin: {:one, :origin}, inertia: {:one, :inertia}]},
    inertia: {[], BB.Dsl.Inertia, []},
    visual: {
      [],
      BB.Dsl.Visual,
      @geometry ++ [material: {:one, :material}, origin: {:one, :origin}]
    },
    collision: {@maybe_named, BB.Dsl.Collision, @geometry ++ [origin: {:one, :origin}]},
    box: {[], BB.Dsl.Box, []},
    cylinder: {[], BB.Dsl.Cylinder, []},
    sphere: {[], BB.Dsl.Sphere, []},
    capsule: {[], BB.Dsl.Capsule, []},
    mesh: {[], BB.Dsl.Mesh, []},
    material: {
      @maybe_named,
      BB.Dsl.Material,
      [color: {:one, :color}, texture: {:one, :texture}]
    },
    color: {[], BB.Dsl.Color, []},
    texture: {[], BB.Dsl.Texture, []},
    param: {@named, BB.Dsl.Param, []},
    group: {@named, BB.Dsl.ParamGroup, [param: {:many, :params}, group: {:many, :groups}]},
    command: {@named, BB.Dsl.Command, [argument: {:many, :arguments}]},
    argument: {[name: :required, type: :optional], BB.Dsl.Command.Argument, []},
    category: {@named, BB.Dsl.Category, []},
    state: {@named, BB.Dsl.State, []},
    i2c: {@named, nil, [device: {:many, :devices}]},
    gpio: {@named, nil, [device: {:many, :devices}]},
    device: {@component, nil, []}
  ]

  @kinds Keyword.keys(@table)
  @components [:sensor, :actuator, :controller]
  @joint_types [:revolute, :continuous, :prismatic, :fixed, :floating, :planar]

  # Entities whose names hold for the whole robot, whatever their kind.
  @unique @components ++ [:link, :joint, :estimator, :bridge, :material, :collision]

  # Whether the fields of an entity may refer to parameters.
  @following [:origin, :axis, :limit, :dynamics, :transmission, :inertial, :inertia]

  @doc "Returns all kinds of entities."
  @spec kinds() :: [atom()]
  def kinds, do: @kinds

  @doc "Returns the types of joints."
  @spec joint_types() :: [atom()]
  def joint_types, do: @joint_types

  @doc "Returns the kinds of components."
  @spec components() :: [atom()]
  def components, do: @components

  @doc "Returns the shapes of a visual or a collision."
  @spec geometries() :: [atom()]
  def geometries, do: @geometries

  @doc "Returns the arguments of an entity's word, in order."
  @spec arguments(atom()) :: [{atom(), :required | :optional}]
  def arguments(kind), do: kind |> row() |> elem(0)

  @doc "Returns the struct that an entity becomes for `BB.Dsl.Info`, or `nil`."
  @spec struct_of(atom()) :: module() | nil
  def struct_of(kind), do: kind |> row() |> elem(1)

  @doc """
  Returns the entities inside an entity: `[kind: {:one | :many, key}]`, with their key in its
  struct.
  """
  @spec holds(atom()) :: [{atom(), {:one | :many, atom()}}]
  def holds(kind), do: kind |> row() |> elem(2)

  @doc "Returns the kinds of the entities that may stand inside an entity of `kind`."
  @spec entities(atom()) :: [atom()]
  def entities(kind), do: kind |> holds() |> Keyword.keys()

  @doc "Tells whether entities of `kind` have a name."
  @spec named?(atom()) :: boolean()
  def named?(kind), do: Keyword.has_key?(arguments(kind), :name)

  @doc "Tells whether an entity of `kind` may be declared without its name."
  @spec nameless?(atom()) :: boolean()
  def nameless?(kind), do: arguments(kind)[:name] == :optional

  @doc "Tells whether the name of an entity is unique among all kinds of the robot."
  @spec unique?(atom()) :: boolean()
  def unique?(kind), do: kind in @unique

  @doc "Tells whether the fields of an entity of `kind` may refer to a parameter."
  @spec follows?(atom()) :: boolean()
  def follows?(kind), do: kind in @following

  @doc """
  Returns the numbers of arguments of an entity's word: its arguments, then fields as keywords, a
  block, or both.

      iex> {BB.Dsl.Grammar.arities(:origin), BB.Dsl.Grammar.arities(:sensor)}
      {0..2, 2..4}
  """
  @spec arities(atom()) :: Range.t()
  def arities(kind) do
    arguments = arguments(kind)
    required = Enum.count(arguments, &match?({_name, :required}, &1))
    required..(length(arguments) + 2)
  end

  @doc "Returns the names of the fields of an entity, as words."
  @spec field_words(atom()) :: [atom()]
  def field_words(kind),
    do: Keyword.keys(Fields.of(kind)) ++ if(nameless?(kind), do: [:name], else: [])

  @doc "Returns all words that may stand inside an entity of `kind`."
  @spec words(atom()) :: [atom()]
  def words(kind), do: field_words(kind) ++ entities(kind)

  @doc "Returns the kinds of entities in which a word may stand."
  @spec homes(atom()) :: [atom()]
  def homes(word), do: Enum.filter(@kinds, &(word in words(&1)))

  @doc """
  Returns every word with the numbers of its arguments, for `locals_without_parens` in
  `.formatter.exs`.
  """
  @spec calls() :: [{atom(), pos_integer()}]
  def calls do
    entities = for kind <- @kinds, kind != :robot, n <- arities(kind), n > 0, do: {kind, n}
    fields = for kind <- @kinds, field <- field_words(kind), do: {field, 1}
    Enum.sort(Enum.uniq(entities ++ fields))
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
  def describe(:device), do: "a simulated device"
  def describe(:param), do: "a parameter"
  def describe(:group), do: "a group of parameters"

  def describe(kind) when kind in [:inertia, :dynamics], do: "#{kind}"

  def describe(kind) do
    cond do
      kind in entities(:robot) -> "#{kind}"
      String.first("#{kind}") in ~w(a e i o u) -> "an #{kind}"
      true -> "a #{kind}"
    end
  end

  defp row(kind), do: Keyword.fetch!(@table, kind)
end
