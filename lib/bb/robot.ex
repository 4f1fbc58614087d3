defmodule BB.Robot do
  @moduledoc """
  The description of a robot as data, in SI units. `MyRobot.robot()` returns it. Use it to list
  a robot's parts, to find the way between two of them, and to compute where they are.

      {:ok, shoulder} = BB.Robot.get_joint(MyRobot.robot(), :shoulder)
      shoulder.limits.upper
      #=> 1.5707963267948966

      BB.Robot.path_to(MyRobot.robot(), :arm)
      #=> {:ok, [:base_link, :shoulder, :arm]}

  Its fields:

    * `:name` - the robot's module
    * `:settings` - the fields of `settings` as declared, such as `%{name: :my_robot}`
    * `:root_link` - the name of the root link, `nil` without one
    * `:links`, `:joints` - by name: `BB.Robot.Link`, `BB.Robot.Joint`
    * `:sensors` - by name, a map with `:name`, `:attached_to` (`:robot`, `{:link, name}` or
      `{:joint, name}`) and `:transmission` (a `t:BB.Transmission.t/0` or `nil`)
    * `:actuators` - by name, as sensors, and with `:joint`, the name of its joint
    * `:controllers` - by name, as sensors
    * `:topology` - the tree of links and joints, a `BB.Robot.Topology`
    * `:parameters` - their definitions in the order of the declaration, each a
      `BB.Parameter.Definition`
    * `:components` - all components in the order of the declaration, each a `BB.Component`; the
      supervisors start them
    * `:simulation` - the simulated buses and their devices, as `BB.Bus.Sim` and
      `BB.Bus.Sim.Lines` take them:
      `%{i2c: [{"i2c-1", clock_hz: 400_000, devices: [{0x68, device}]}], gpio: […]}`
    * `:param_subscriptions` - the places that follow each parameter, by the path of the
      parameter: `{:joint, :shoulder, [:limits, :upper]}`, `{:joint, :wrist, [:axis, :roll]}`,
      `{:sensor, :encoder, [:transmission, :offset]}`, `{:link, :arm, [:mass]}`
    * `:declared_axes` - by joint, the `BB.Dsl.Axis` of an axis that follows parameters

  A place that follows a parameter is `nil` in `MyRobot.robot()`, and so is a whole axis.
  `resolve/2` puts in values; `BB.Robot.Runtime.get_robot/1` returns the description with the
  current values of a robot that runs.
  """

  alias BB.Component
  alias BB.Error.Kinematics.{NoParentJoint, UnknownActuator, UnknownJoint, UnknownLink}
  alias BB.Robot.{Joint, Kinematics, Link, Resolved, Topology}

  @enforce_keys [:name]
  defstruct [
    :name,
    :root_link,
    settings: %{},
    links: %{},
    joints: %{},
    sensors: %{},
    actuators: %{},
    controllers: %{},
    topology: %Topology{},
    parameters: [],
    components: [],
    simulation: %{i2c: [], gpio: []},
    param_subscriptions: %{},
    declared_axes: %{}
  ]

  @type attached :: %{
          name: atom(),
          attached_to: :robot | {:link, atom()} | {:joint, atom()},
          transmission: transmission() | nil
        }

  @type actuator :: %{
          name: atom(),
          joint: atom(),
          attached_to: {:joint, atom()},
          transmission: transmission() | nil
        }

  @typedoc "A transmission; a field that follows a parameter is `nil`."
  @type transmission :: %{
          reduction: float() | nil,
          offset: float() | nil,
          reversed?: boolean() | nil
        }

  @typedoc "A place that follows a parameter: the part, its name and the field."
  @type subscription :: {:link | :joint | :sensor | :actuator, atom(), [atom()]}

  @type t :: %__MODULE__{
          name: module(),
          root_link: atom() | nil,
          settings: %{atom() => term()},
          links: %{atom() => Link.t()},
          joints: %{atom() => Joint.t()},
          sensors: %{atom() => attached()},
          actuators: %{atom() => actuator()},
          controllers: %{atom() => attached()},
          topology: Topology.t(),
          parameters: [BB.Parameter.Definition.t()],
          components: [Component.t()],
          simulation: %{i2c: [{String.t(), keyword()}], gpio: [{String.t(), keyword()}]},
          param_subscriptions: %{BB.Parameter.path() => [subscription()]},
          declared_axes: %{atom() => map()}
        }

  @doc "Returns the name of the root link."
  @spec root_link(t()) :: atom() | nil
  def root_link(%__MODULE__{root_link: name}), do: name

  @doc "Returns a link: `{:ok, link}`, or `{:error, %BB.Error.Kinematics.UnknownLink{}}`."
  @spec get_link(t(), atom()) :: {:ok, Link.t()} | {:error, Exception.t()}
  def get_link(%__MODULE__{links: links} = robot, name) do
    with :error <- Map.fetch(links, name),
         do: {:error, %UnknownLink{link: name, robot: robot.name}}
  end

  @doc "Returns a joint: `{:ok, joint}`, or `{:error, %BB.Error.Kinematics.UnknownJoint{}}`."
  @spec get_joint(t(), atom()) :: {:ok, Joint.t()} | {:error, Exception.t()}
  def get_joint(%__MODULE__{joints: joints} = robot, name) do
    with :error <- Map.fetch(joints, name),
         do: {:error, %UnknownJoint{joint: name, robot: robot.name}}
  end

  @doc "Fetches a link by its name: `{:ok, link}` or `:error`."
  @spec fetch_link(t(), atom()) :: {:ok, Link.t()} | :error
  def fetch_link(%__MODULE__{links: links}, name), do: Map.fetch(links, name)

  @doc "Fetches a joint by its name: `{:ok, joint}` or `:error`."
  @spec fetch_joint(t(), atom()) :: {:ok, Joint.t()} | :error
  def fetch_joint(%__MODULE__{joints: joints}, name), do: Map.fetch(joints, name)

  @doc """
  Returns the joint that carries a link: `{:ok, joint}`.

  The root link has none: `{:error, %BB.Error.Kinematics.NoParentJoint{}}`.
  """
  @spec parent_joint(t(), atom()) :: {:ok, Joint.t()} | {:error, Exception.t()}
  def parent_joint(%__MODULE__{} = robot, link_name) do
    case get_link(robot, link_name) do
      {:ok, %Link{parent_joint: nil}} -> {:error, %NoParentJoint{link: link_name}}
      {:ok, %Link{parent_joint: joint}} -> get_joint(robot, joint)
      error -> error
    end
  end

  @doc "Returns the joints that a link carries, in order: `{:ok, joints}`."
  @spec child_joints(t(), atom()) :: {:ok, [Joint.t()]} | {:error, Exception.t()}
  def child_joints(%__MODULE__{} = robot, link_name) do
    with {:ok, link} <- get_link(robot, link_name),
         do: {:ok, Enum.map(link.child_joints, &Map.fetch!(robot.joints, &1))}
  end

  @doc """
  Returns the names from the root link to a link or joint: `{:ok, [root, joint, link, …, name]}`.
  """
  @spec path_to(t(), atom()) :: {:ok, [atom()]} | {:error, Exception.t()}
  def path_to(%__MODULE__{} = robot, name),
    do: robot.topology |> Topology.path_to(name) |> name_robot(robot)

  @doc """
  Returns the names from a link down to another: `{:ok, [source, joint, …, target]}`.

  See `BB.Robot.Topology.path_between/3`.
  """
  @spec path_between(t(), atom(), atom()) :: {:ok, [atom()]} | {:error, Exception.t()}
  def path_between(%__MODULE__{} = robot, source, target),
    do: robot.topology |> Topology.path_between(source, target) |> name_robot(robot)

  defp name_robot({:error, %UnknownLink{} = error}, robot),
    do: {:error, %{error | robot: robot.name}}

  defp name_robot(result, _robot), do: result

  @doc """
  Returns the path of an actuator, `{:ok, [link, joint, …, name]}`, which its driver knows as
  `bb.path`.
  """
  @spec actuator_path(t(), atom()) :: {:ok, [atom()]} | {:error, Exception.t()}
  def actuator_path(%__MODULE__{} = robot, name) do
    case robot.actuators do
      %{^name => %{joint: joint}} -> {:ok, robot.topology.paths[joint] ++ [name]}
      _ -> {:error, %UnknownActuator{actuator: name, robot: robot.name}}
    end
  end

  @doc "Returns the links: parents before children, siblings in the order of the declaration."
  @spec links_in_order(t()) :: [Link.t()]
  def links_in_order(%__MODULE__{} = robot),
    do: Enum.map(robot.topology.link_order, &Map.fetch!(robot.links, &1))

  @doc "Returns the joints: parents before children, siblings in the order of the declaration."
  @spec joints_in_order(t()) :: [Joint.t()]
  def joints_in_order(%__MODULE__{} = robot),
    do: Enum.map(robot.topology.joint_order, &Map.fetch!(robot.joints, &1))

  @doc "Fetches a component by its name: `{:ok, component}` or `:error`."
  @spec fetch_component(t(), atom()) :: {:ok, Component.t()} | :error
  def fetch_component(%__MODULE__{components: components}, name) do
    case Enum.find(components, &(&1.name == name)) do
      nil -> :error
      component -> {:ok, component}
    end
  end

  @doc """
  Returns the components on the robot itself (`nil`), on a link or on a joint, in the order of the
  declaration.
  """
  @spec components_on(t(), Component.attachment()) :: [Component.t()]
  def components_on(%__MODULE__{components: components}, place),
    do: Enum.filter(components, &(&1.attached_to == place))

  @doc """
  Returns the description with the values of parameters in the places that follow them.

  `fetch` returns the value of a parameter's path, or `nil` where it has none.
  """
  @spec resolve(t(), (BB.Parameter.path() -> term())) :: t()
  defdelegate resolve(robot, fetch), to: Resolved

  @doc """
  Returns the pose of the link `to` in the frame of the link `from`, for given positions of the
  joints: `{:ok, transform}`.

  The transform converts the coordinates of a point in the frame of `to` to its coordinates in
  the frame of `from`. See `BB.Robot.Kinematics`.
  """
  @spec transform(t(), atom(), atom(), Kinematics.positions()) ::
          {:ok, BB.Math.Transform.t()} | {:error, Exception.t()}
  defdelegate transform(robot, from, to, positions \\ %{}), to: Kinematics
end
