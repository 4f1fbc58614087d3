defmodule BB.Robot.State do
  @moduledoc """
  The positions and velocities of a robot's joints, in a table that any process reads and writes.

  `BB.Robot.Runtime` keeps one for each robot that runs, with what its sensors report. Make one of
  your own to try positions:

      iex> arm = %BB.Robot.Joint{
      ...>   name: :arm,
      ...>   type: :revolute,
      ...>   parent_link: :a,
      ...>   child_link: :b
      ...> }
      iex> {:ok, state} = BB.Robot.State.new(%BB.Robot{name: MyRobot, joints: %{arm: arm}})
      iex> BB.Robot.State.set_configuration(state, :arm, 0.5)
      :ok
      iex> BB.Robot.State.get_configuration(state, :arm)
      {:ok, 0.5}

  | joint | configuration | velocity | at first |
  |---|---|---|---|
  | revolute, continuous, prismatic | a number, rad or m | rad/s or m/s | `0.0` |
  | planar | `BB.Math.Transform2D` | `BB.Message.Geometry.Twist2D` | zero |
  | floating | `BB.Math.Transform` | `BB.Message.Geometry.Twist` | identity, zero |
  | fixed | `0` alone | `0` alone | `0.0` |

  The table belongs to the process that made it.
  """

  alias BB.Error.Kinematics.UnknownJoint
  alias BB.Parameter.{Owner, Values}
  alias BB.Robot
  alias BB.Robot.Configuration

  @enforce_keys [:table, :robot]
  defstruct [:table, :robot, :source]

  @typedoc "A handle. `source` is the robot that runs, whose parameters it reads."
  @type t :: %__MODULE__{table: :ets.table(), robot: Robot.t(), source: module() | nil}

  @doc "Makes a state of a robot, with all joints at their first configuration: `{:ok, state}`."
  @spec new(Robot.t(), module() | nil) :: {:ok, t()}
  def new(%Robot{} = robot, source \\ nil) do
    table = :ets.new(__MODULE__, [:public, read_concurrency: true])
    state = %__MODULE__{table: table, robot: robot, source: source}
    :ok = reset(state)
    {:ok, state}
  end

  @doc "Sets all joints to their first configuration and velocity."
  @spec reset(t()) :: :ok
  def reset(%__MODULE__{table: table, robot: robot}) do
    rows =
      for {name, joint} <- robot.joints,
          field <- [:configuration, :velocity],
          do: {{field, name}, Configuration.first(joint, field)}

    :ets.insert(table, rows)
    :ok
  end

  @doc "Returns the configuration of a joint: `{:ok, value}`, or an error for an unknown joint."
  @spec get_configuration(t(), atom()) :: {:ok, Configuration.t()} | {:error, Exception.t()}
  def get_configuration(state, joint), do: get(state, :configuration, joint)

  @doc "Returns the velocity of a joint: `{:ok, value}`, or an error for an unknown joint."
  @spec get_velocity(t(), atom()) :: {:ok, Configuration.velocity()} | {:error, Exception.t()}
  def get_velocity(state, joint), do: get(state, :velocity, joint)

  @doc """
  Sets the configuration of a joint.

  A value of the wrong shape is an error, `BB.Error.Invalid.JointConfig`.
  """
  @spec set_configuration(t(), atom(), term()) :: :ok | {:error, Exception.t()}
  def set_configuration(state, joint, value), do: put(state, :configuration, [{joint, value}])

  @doc "Sets the configurations of several joints, or of none when one of them is wrong."
  @spec set_configurations(t(), %{atom() => term()} | keyword()) :: :ok | {:error, Exception.t()}
  def set_configurations(state, values), do: put(state, :configuration, values)

  @doc "Sets the velocity of a joint. A value of the wrong shape is an error."
  @spec set_velocity(t(), atom(), term()) :: :ok | {:error, Exception.t()}
  def set_velocity(state, joint, value), do: put(state, :velocity, [{joint, value}])

  @doc "Sets the velocities of several joints, or of none when one of them is wrong."
  @spec set_velocities(t(), %{atom() => term()} | keyword()) :: :ok | {:error, Exception.t()}
  def set_velocities(state, values), do: put(state, :velocity, values)

  @doc "Returns the configurations of all joints."
  @spec get_all_configurations(t()) :: %{atom() => Configuration.t()}
  def get_all_configurations(state), do: all(state, :configuration)

  @doc "Returns the velocities of all joints."
  @spec get_all_velocities(t()) :: %{atom() => Configuration.velocity()}
  def get_all_velocities(state), do: all(state, :velocity)

  @doc """
  Returns the configurations of the joints from the root link to a link, in this order:
  `[{joint, value}]`, empty for the root link and for an unknown one.
  """
  @spec get_chain_configurations(t(), atom()) :: [{atom(), Configuration.t()}]
  def get_chain_configurations(%__MODULE__{robot: robot} = state, link) do
    path = with {:ok, path} <- Robot.path_to(robot, link), do: path, else: (_error -> [])

    for name <- path, is_map_key(robot.joints, name) do
      {:ok, value} = get_configuration(state, name)
      {name, value}
    end
  end

  @doc "Returns the value of a parameter: `{:ok, value}`, or `{:error, :not_found}`."
  @spec get_parameter(t(), BB.Parameter.path()) :: {:ok, term()} | {:error, :not_found}
  def get_parameter(%__MODULE__{source: nil, table: table}, path) do
    case :ets.lookup(table, {:parameter, path}) do
      [{_key, value}] -> {:ok, value}
      [] -> {:error, :not_found}
    end
  end

  def get_parameter(%__MODULE__{source: robot}, path) do
    with :error <- Values.fetch(robot, path), do: {:error, :not_found}
  end

  @doc """
  Sets the value of a parameter without a check and without a message. What follows the parameter
  gets the value. `BB.Parameter.set/3` is for everything but tests.
  """
  @spec set_parameter(t(), BB.Parameter.path(), term()) :: :ok
  def set_parameter(%__MODULE__{source: nil, table: table}, path, value) do
    :ets.insert(table, {{:parameter, path}, value})
    :ok
  end

  def set_parameter(%__MODULE__{source: robot}, path, value),
    do: Owner.call(robot, {:put, path, value})

  defp get(%__MODULE__{table: table, robot: robot}, field, joint) do
    case :ets.lookup(table, {field, joint}) do
      [{_key, value}] -> {:ok, value}
      [] -> {:error, %UnknownJoint{joint: joint, robot: robot.name}}
    end
  end

  defp all(%__MODULE__{table: table}, field),
    do:
      table
      |> :ets.match({{field, :"$1"}, :"$2"})
      |> Map.new(fn [name, value] -> {name, value} end)

  defp put(%__MODULE__{table: table, robot: robot}, field, values) do
    checked = for {name, value} <- values, do: {name, check_named(robot, field, name, value)}

    case Enum.find(checked, &match?({_name, {:error, _}}, &1)) do
      nil ->
        :ets.insert(table, for({name, {:ok, value}} <- checked, do: {{field, name}, value}))
        :ok

      {_name, error} ->
        error
    end
  end

  defp check_named(robot, field, name, value) do
    with {:ok, joint} <- Robot.get_joint(robot, name),
         do: Configuration.check(joint, field, value)
  end
end
