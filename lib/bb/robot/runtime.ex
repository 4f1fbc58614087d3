defmodule BB.Robot.Runtime do
  @moduledoc """
  What a robot that runs knows of itself: its description with the current parameters, and the
  positions and velocities of its joints. Use it in tools and in user interfaces.

      BB.Robot.Runtime.configurations(MyRobot)
      #=> %{shoulder: 0.52, elbow: -1.2}

      BB.Robot.Runtime.get_robot(MyRobot).joints.shoulder.limits.upper
      #=> 1.5707963267948966

  The positions come from the `BB.Message.Sensor.JointState` messages below `[:sensor]`. An entry
  for an unknown joint, or of the wrong shape for its joint, is skipped. A joint that no sensor
  reports stays at its first configuration (`BB.Robot.State`).

  All functions but `via/1` and `state/1` raise `ArgumentError` when the robot is not started.
  """

  use GenServer
  use BB.Process.Tolerant

  alias BB.{Message, Parameter, PubSub, Robot, Safety}
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
  Returns the state of the robot: `:disarmed`, `:disarming`, `:error`, or `:idle` while it is
  armed.
  """
  @spec state(module()) :: atom()
  def state(robot) do
    case Safety.state(robot) do
      :armed -> :idle
      state -> state
    end
  end

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
