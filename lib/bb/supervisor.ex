defmodule BB.Supervisor do
  @moduledoc """
  The root supervisor of a robot, registered under the robot's module. `use BB` defines
  `MyRobot.start_link/1`, which starts it.

      MyRobot                          one_for_one
      ├── MyRobot.Registry             the names of components
      ├── MyRobot.PubSub               the pubsub
      ├── runtime                      BB.Parameter.Supervisor, the parameters and then
      │                                BB.Robot.Runtime, the positions of the joints
      ├── ▌ BB.Supervisor.Simulation   simulated buses, if the robot declares and uses them
      ├── BB.Safety.Latch              delays the end until the robot is disarmed
      ├── ▌ BB.Supervisor.Tasks        BB.TaskSupervisor, a Task.Supervisor for anybody
      ├── BB.TopologySupervisor        BB.Supervisor.Topology
      │   ├── BB.SensorSupervisor      BB.Supervisor.Topology
      │   │   └── :battery             BB.Component.Keeper ── BB.Component.Server
      │   ├── BB.ControllerSupervisor  BB.Supervisor.Topology
      │   └── link :base_link          BB.Supervisor.Topology
      │       ├── :imu                 BB.Component.Keeper ── BB.Component.Server
      │       └── joint :shoulder      BB.Supervisor.Topology …
      ├── ▌ BB.BridgeSupervisor        ▌ each bridge, BB.Bridge
      ├── ▌ BB.Command.Supervisor      the commands
      └── BB.Safety.StopNotice         announces that the robot is being stopped

  A keeper handles each component that crashes, hangs or misses its device
  (`BB.Component.Keeper`). No supervisor sees such a failure, so none restarts for it. ▌ is a
  bulkhead (`BB.Process.Bulkhead`), which starts its child again when it ends.
  """

  use Supervisor

  alias BB.{Callback, Topic}
  alias BB.Component.{OptionsCheck, Resolution}
  alias BB.Options.ValidationError
  alias BB.Parameter.Startup
  alias BB.Process.{Bulkhead, Successor}
  alias BB.Robot.SimulationMode
  alias BB.Supervisor.{SimulatedComponents, Simulation, Tasks, Topology}

  @options BB.Options.new!(
             params: [
               type: :keyword_list,
               default: [],
               doc:
                 "Values of parameters, nested as the parameters: " <>
                   "`[imu: [rate: ~u(50 hertz)]]`. They override persisted values and defaults."
             ],
             simulation: [
               type: {:in, [nil, :kinematic, :external]},
               default: nil,
               doc:
                 "How the robot is simulated, `nil` for its own hardware. Its actuators are " <>
                   "`BB.Sim.Actuator`, and a controller is what its field `simulation` says."
             ],
             topic_prefix: [
               type: {:or, [{:custom, BB.Topic, :check_prefix, []}, nil]},
               default: nil,
               doc:
                 "The robot's topic prefix (`BB.Topic`); `nil` for that of the robot's settings."
             ]
           )

  @doc """
  Starts a robot.

  Returns `{:error, error}` with a `BB.Options.ValidationError`, and starts nothing, when a
  component's schema refuses its options, or when a value in `params:` is wrong. The message of
  the error ends in the path of the component:

      unknown options [:buss], valid options are: [:bus, :rate] (in options [:base_link, :imu])

  ## Options

  #{BB.Options.docs(@options)}
  """
  @spec start_link(module(), keyword()) :: Supervisor.on_start() | {:error, ValidationError.t()}
  def start_link(robot, opts \\ []) do
    declared = robot.robot()

    with {:ok, opts} <- BB.Options.validate(opts, @options),
         {:ok, given} <- Startup.given(declared.parameters, opts[:params]),
         :ok <- check_options(declared.components, robot, values(declared.parameters, given)),
         :ok <- check_topics(declared.components, opts[:topic_prefix]) do
      # A robot that runs keeps its topic prefix and its mode.
      _ = if Process.whereis(robot) == nil, do: put_options(robot, declared.components, opts)
      supervisor = BB.Process.supervisor_module(robot)
      supervisor.start_link(__MODULE__, {robot, given}, name: robot)
    end
  end

  defp put_options(robot, components, opts) do
    :ok = Topic.put_prefix(robot, opts[:topic_prefix])
    SimulationMode.put(robot, opts[:simulation], SimulatedComponents.of(components))
  end

  @doc """
  Formats the reason for which a robot did not start.

  Takes the error of `start_link/2`, or the error of a supervisor or an application with the robot
  among its children.

      iex> message = "unknown options [:buss]"
      iex> error = %BB.Options.ValidationError{message: message, keys_path: [:imu]}
      iex> BB.Supervisor.format_error({:shutdown, {:failed_to_start_child, MyRobot, error}})
      "unknown options [:buss] (in options [:imu])"
  """
  @spec format_error(term()) :: String.t()
  def format_error({:shutdown, reason}), do: format_error(reason)
  def format_error({:failed_to_start_child, _id, reason}), do: format_error(reason)
  def format_error({{:shutdown, _} = reason, {_module, :start, _args}}), do: format_error(reason)
  def format_error(error) when is_exception(error), do: Exception.message(error)
  def format_error(reason), do: Exception.format_exit(reason)

  # The greatest size of an inhibition's reason in bytes. A table holds the reason.
  @largest_reason 65_536

  @impl Supervisor
  def init({robot, given}) do
    _ = inhibit(robot)
    BB.Safety.Wardens.watch(robot, :root)

    # Handlers run when the latch ends, before the simulated buses end.
    children =
      [
        Successor.child_spec(BB.Process.registry_spec(robot)),
        Successor.child_spec({BB.PubSub, robot}),
        Successor.child_spec({BB.Parameter.Supervisor, {robot, given, [runtime(robot)]}})
      ] ++
        Simulation.children(robot) ++
        [
          {BB.Safety.Latch, robot},
          Bulkhead.child_spec({Tasks, robot}),
          {Topology, {robot, nil}},
          Bulkhead.child_spec({BB.BridgeSupervisor, robot}),
          Bulkhead.child_spec({BB.Command.Supervisor, robot}),
          {BB.Safety.StopNotice, {robot, self()}}
        ]

    Supervisor.init(children, strategy: :one_for_one)
  end

  # It has a name in the registry, and cannot start again before the registry has.
  defp runtime(robot), do: Bulkhead.child_spec({BB.Robot.Runtime, robot})

  # Before the robot can be armed.
  defp inhibit(robot) do
    for %{module: module, path: path} <- SimulationMode.components(robot),
        Code.ensure_loaded?(module) and function_exported?(module, :inhibition, 0),
        do: BB.Safety.inhibit(robot, path, inhibition(module))
  end

  # A component that fails to give its reason forbids arming too.
  defp inhibition(module) do
    opts = [
      accept: &accept_small/1,
      expected: "a reason of #{@largest_reason} bytes at most",
      instead: "the robot may not be armed until the component allows it"
    ]

    case Callback.call({module, :inhibition, []}, opts) do
      {:ok, reason} -> reason
      {:error, failure} -> {:inhibition_failed, Callback.format_failure(failure)}
    end
  end

  defp accept_small(reason),
    do: if(:erlang.external_size(reason) <= @largest_reason, do: {:ok, reason}, else: :error)

  defp values(definitions, given),
    do: definitions |> Map.new(&{&1.path, &1.default}) |> Map.merge(given)

  # A check that fails by itself shows when the component starts.
  defp check_options(components, robot, values) do
    components
    |> Enum.map(&{Resolution.of(robot, &1), values})
    |> Enum.filter(&resolvable?/1)
    |> OptionsCheck.run()
    |> Enum.find(:ok, &match?({:error, %ValidationError{}}, &1))
  end

  # The compiler has checked the topic prefix of the settings.
  defp check_topics(_components, nil), do: :ok

  defp check_topics(components, prefix) do
    Enum.find_value(components, :ok, fn component ->
      Enum.find_value(topics(component), &topic_error(&1, prefix, component.path))
    end)
  end

  defp topics(%{module: module, options: options}) do
    opts = [expected: "a list of names", instead: "its topics are checked when it starts"]

    if Code.ensure_loaded?(module) and function_exported?(module, :topics, 1),
      do:
        topic_names(
          Callback.call({module, :topics, [options]}, [accept: &accept_names/1] ++ opts)
        ),
      else: []
  end

  defp topic_names({:ok, names}), do: names
  defp topic_names({:error, _failure}), do: []

  defp accept_names(names),
    do: if(is_list(names) and Enum.all?(names, &is_binary/1), do: {:ok, names}, else: :error)

  defp topic_error(name, prefix, path) do
    case Topic.resolve(name, prefix) do
      {:ok, _topic} ->
        nil

      {:error, why} ->
        error = %ValidationError{message: why, key: :topic_prefix, value: prefix, keys_path: path}
        {:error, error}
    end
  end

  # A parameter without a default may have a persisted value.
  defp resolvable?({resolution, values}),
    do: Enum.all?(Resolution.paths(resolution), &(values[&1] != nil))
end
