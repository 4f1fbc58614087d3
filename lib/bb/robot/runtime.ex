defmodule BB.Robot.Runtime do
  @moduledoc """
  What a robot that runs knows of itself: its description with the current parameters, the
  positions and velocities of its joints, its state and its commands. Use it in tools and in user
  interfaces.

      BB.Robot.Runtime.configurations(MyRobot)
      #=> %{shoulder: 0.52, elbow: -1.2}

      BB.Robot.Runtime.get_robot(MyRobot).joints.shoulder.limits.upper
      #=> 1.5707963267948966

  The positions come from the `BB.Message.Sensor.JointState` messages below `[:sensor]`. An entry
  for an unknown joint, or of the wrong shape for its joint, is skipped. A joint that no sensor
  reports stays at its first configuration (`BB.Robot.State`).

  ## State

  `state/1` is the robot's safety state unless it is armed, and its operational state while it is:
  `:idle` or one of its `states`. While commands run in `:idle` it is `:executing`. Arming a robot
  begins in its `initial_state`. Each change is published as `BB.StateMachine.Transition` on
  `[:state_machine]`.

      {:ok, command} = BB.Robot.Runtime.execute(MyRobot, :wave, %{times: 2})
      BB.Robot.Runtime.state(MyRobot)
      #=> :executing
      {:ok, :waved} = BB.Command.await(command)

  All functions but `via/1` and `state/1` raise `ArgumentError` when the robot is not started.
  """

  use GenServer
  use BB.Process.Tolerant

  alias BB.{Message, Parameter, PubSub, Robot, Safety}
  alias BB.Command.{Admission, Dispatcher, Executions, Goal}
  alias BB.Message.Sensor.JointState
  alias BB.Parameter.Values
  alias BB.Robot.{Configuration, Joint, SimulationMode, State}

  # More readings than a robot publishes while its runtime is suspended for a moment.
  @max_queue 10_000

  @doc """
  Returns the description of the robot with the current values of its parameters.
  """
  @spec get_robot(module()) :: Robot.t()
  def get_robot(robot) do
    Robot.resolve(robot.robot(), fn path ->
      with {:ok, value} <- Parameter.get(robot, path), do: value, else: (_none -> nil)
    end)
  end

  @doc "Returns the positions and velocities of the joints as a `BB.Robot.State`."
  @spec get_robot_state(module()) :: State.t()
  def get_robot_state(robot) do
    case BB.Process.whereis(robot, __MODULE__) do
      pid when is_pid(pid) -> GenServer.call(pid, :state)
      :undefined -> Values.not_started!(robot)
    end
  end

  @doc """
  Returns the state of the robot: `:disarmed`, `:disarming`, `:error`, or its operational state
  while it is armed, but `:executing` while commands run in `:idle`.
  """
  @spec state(module()) :: atom()
  def state(robot) do
    case Safety.state(robot) do
      :armed -> Executions.state(robot)
      state -> state
    end
  end

  @doc """
  Returns the operational state of the robot, which it keeps while it is disarmed.
  """
  @spec operational_state(module()) :: atom()
  defdelegate operational_state(robot), to: Executions, as: :operational

  @doc """
  Changes the operational state of the robot.

  Returns `{:error, %BB.Error.State.Invalid{}}` for a state that the robot does not have.
  """
  @spec transition(module(), atom()) :: :ok | {:error, term()}
  defdelegate transition(robot, state), to: Dispatcher

  @doc """
  Executes a command, and returns the process of its execution: `{:ok, pid}`.

  `goal` has the arguments of the command (`coerce_goal/2`). `BB.Command.await/2` waits for the
  result. Errors:

    * `{:unknown_command, name}`
    * `%BB.Error.Invalid.Command{}` - a required argument is missing
    * `:safety_error`, `:disarming` - no command starts in these states
    * `%BB.Error.State.NotAllowed{}` - the command is not allowed in the state of the robot
    * `%BB.Error.Category.Full{}` - as many commands of its category run as may
    * `:unavailable` - the processes that execute commands are being restarted
  """
  @spec execute(module(), atom(), map() | keyword()) :: {:ok, pid()} | {:error, term()}
  def execute(robot, name, goal \\ %{}) when is_atom(name),
    do: Dispatcher.execute(robot, name, Map.new(goal))

  @doc """
  Turns the strings in a goal, which come from forms, into values of the arguments' types, and
  adds defaults.

      iex> angle = %BB.Dsl.Command.Argument{name: :angle, type: :float, default: 0.5}
      iex> BB.Robot.Runtime.coerce_goal(%{angle: "1.25"}, [angle])
      %{angle: 1.25}
      iex> BB.Robot.Runtime.coerce_goal(%{}, [angle])
      %{angle: 0.5}
  """
  @spec coerce_goal(map() | keyword(), [BB.Dsl.Command.Argument.t()]) :: map()
  defdelegate coerce_goal(goal, arguments), to: Goal, as: :coerce

  @doc "Cancels all executions. Returns `{:error, :no_execution}` when no command runs."
  @spec cancel(module()) :: :ok | {:error, :no_execution | :unavailable}
  defdelegate cancel(robot), to: Dispatcher

  @doc "Returns whether a command runs."
  @spec executing?(module()) :: boolean()
  def executing?(robot), do: executing_commands(robot) != []

  @doc "Returns whether a command of a category runs."
  @spec executing?(module(), atom()) :: boolean()
  def executing?(robot, category),
    do: Enum.any?(executing_commands(robot), &(&1.category == category))

  @doc "Returns the commands that run, the oldest first."
  @spec executing_commands(module()) :: [Executions.execution()]
  defdelegate executing_commands(robot), to: Executions, as: :list

  @doc """
  Returns how many commands of each category run, and how many may:
  `%{category => {running, limit}}`.
  """
  @spec category_availability(module()) :: %{atom() => {non_neg_integer(), pos_integer()}}
  def category_availability(robot) do
    running = robot |> executing_commands() |> Enum.frequencies_by(& &1.category)

    Map.new(Executions.limits(robot), fn {category, limit} ->
      {category, {Map.get(running, category, 0), limit}}
    end)
  end

  @doc """
  Checks that a command with these `allowed_states` could start in the state of the robot: `:ok`,
  or the error of `execute/3`.
  """
  @spec check_allowed(module(), [atom()]) :: :ok | {:error, term()}
  def check_allowed(robot, states),
    do: Admission.check_allowed(:command, List.wrap(states), Executions.situation(robot))

  @doc "Returns the positions of all joints: floats in rad or m, or transforms."
  @spec configurations(module()) :: %{atom() => Configuration.t()}
  def configurations(robot), do: robot |> get_robot_state() |> State.get_all_configurations()

  @doc "Returns the velocities of all joints."
  @spec velocities(module()) :: %{atom() => Configuration.velocity()}
  def velocities(robot), do: robot |> get_robot_state() |> State.get_all_velocities()

  @doc "Returns how the robot is simulated, `nil` for a robot that is not."
  @spec simulation_mode(module()) :: SimulationMode.mode() | nil
  def simulation_mode(robot) do
    _ = get_robot_state(robot)
    SimulationMode.mode(robot)
  end

  @doc "Returns the name of the robot's runtime for `GenServer.call/3` and the like."
  @spec via(module()) :: {:via, module(), {module(), module()}}
  def via(robot), do: BB.Process.via(robot, __MODULE__)

  @doc false
  @spec start_link(module()) :: GenServer.on_start()
  def start_link(robot), do: GenServer.start_link(__MODULE__, robot, name: via(robot))

  @impl GenServer
  def init(robot) do
    {:ok, state} = State.new(robot.robot(), robot)
    if moves?(robot), do: subscribe(robot)
    {:ok, state}
  end

  defp moves?(robot),
    do: Enum.any?(robot.robot().joints, fn {_, joint} -> Joint.movable?(joint) end)

  defp subscribe(robot) do
    {:ok, _bus} =
      PubSub.subscribe(robot, [:sensor], message_types: [JointState], max_queue: @max_queue)

    :ok
  end

  @impl GenServer
  def handle_call(:state, _from, state), do: {:reply, state, state}

  @impl GenServer
  def handle_info({:bb, [:sensor | _], %Message{payload: %JointState{} = reading}}, state) do
    set_each(reading.names, reading.positions, &State.set_configuration(state, &1, &2))
    set_each(reading.names, reading.velocities, &State.set_velocity(state, &1, &2))
    {:noreply, state}
  end

  # A joint of another robot, and a value of another shape, change nothing.
  defp set_each(names, values, set) do
    names
    |> Enum.zip(values)
    |> Enum.each(fn {name, value} -> _ = set.(name, value) end)
  end
end
