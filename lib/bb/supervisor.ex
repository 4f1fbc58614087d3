defmodule BB.Supervisor do
  @moduledoc """
  The root of a robot's processes, registered under the robot's module.

      MyRobot                          one_for_one
      ├── MyRobot.Registry             names of components
      ├── MyRobot.PubSub               the bus
      ├── runtime                      BB.Parameter.Supervisor, the robot's parameters
      ├── ▌ BB.Supervisor.Simulation   simulated buses, where the robot declares and has them
      ├── BB.Safety.Latch              holds the end until the robot is disarmed
      └── topology                     BB.Supervisor.Topology
          ├── :battery                 BB.Component.Keeper ── BB.Component.Server
          └── link :base_link          BB.Supervisor.Topology
              ├── :imu                 BB.Component.Keeper ── BB.Component.Server
              └── joint :shoulder      BB.Supervisor.Topology …

  A component that crashes, hangs or misses its device is its keeper's matter alone (`BB.Component.Keeper`): no supervisor
  notices, so none ever restarts for it. ▌ is a bulkhead (`BB.Process.Bulkhead`): simulated buses that
  end are started again there.
  """

  use Supervisor

  alias BB.{Callback, Topic}
  alias BB.Component.{Checked, Resolution}
  alias BB.Options.ValidationError
  alias BB.Parameter.Startup
  alias BB.Process.Successor
  alias BB.Supervisor.{Simulation, Topology}

  @options BB.Options.new!(
             params: [
               type: :keyword_list,
               default: [],
               doc:
                 "Values of parameters, nested as they are: `[imu: [rate: ~u(50 hertz)]]`. They go before persisted values and defaults."
             ],
             topic_prefix: [
               type: {:or, [{:custom, BB.Topic, :check_prefix, []}, nil]},
               default: nil,
               doc:
                 "What goes before the names of its ring topics (`BB.Topic`); `nil` is that of its settings."
             ]
           )

  @doc """
  Starts a robot.

  Options of a component that its schema refuses are a mistake in the robot's declaration: nothing is started then, and the
  result is `{:error, error}` with a `BB.Options.ValidationError`. `Exception.message(error)` is a sentence for people, which
  ends in the path of the component:

      unknown options [:buss], valid options are: [:bus, :rate] (in options [:base_link, :imu])

  The same holds for a value of a parameter in `params:`.

  #{BB.Options.docs(@options)}
  """
  @spec start_link(module(), keyword()) :: Supervisor.on_start() | {:error, ValidationError.t()}
  def start_link(robot, opts \\ []) do
    declared = robot.robot()

    with {:ok, opts} <- BB.Options.validate(opts, @options),
         {:ok, given} <- Startup.given(declared.parameters, opts[:params]),
         :ok <- check(declared.components, robot, values(declared.parameters, given)),
         :ok <- check_topics(declared.components, opts[:topic_prefix]) do
      # That of a robot that runs stays.
      _ = if Process.whereis(robot) == nil, do: Topic.put_prefix(robot, opts[:topic_prefix])
      supervisor = BB.Process.supervisor_module(robot)
      supervisor.start_link(__MODULE__, {robot, given}, name: robot)
    end
  end

  @doc """
  Why a robot was not started, as a sentence: for the error of `start_link/2`, and for that of a supervisor or an application
  which has the robot among its children.

      iex> error = %BB.Options.ValidationError{message: "unknown options [:buss]", keys_path: [:imu]}
      iex> BB.Supervisor.format_error({:shutdown, {:failed_to_start_child, MyRobot, error}})
      "unknown options [:buss] (in options [:imu])"
  """
  @spec format_error(term()) :: String.t()
  def format_error({:shutdown, reason}), do: format_error(reason)
  def format_error({:failed_to_start_child, _id, reason}), do: format_error(reason)
  def format_error({{:shutdown, _} = reason, {_module, :start, _args}}), do: format_error(reason)
  def format_error(error) when is_exception(error), do: Exception.message(error)
  def format_error(reason), do: Exception.format_exit(reason)

  # It stands in a table for as long as the component forbids arming, and is shown to who tries.
  @largest_reason 65_536

  @impl Supervisor
  def init({robot, given}) do
    _ = inhibit(robot)
    BB.Safety.Warden.watch(robot, :root)

    # What is disarmed at the end finds its buses.
    children =
      [
        Successor.child_spec(BB.Process.registry_spec(robot)),
        Successor.child_spec({BB.PubSub, robot}),
        Successor.child_spec({BB.Parameter.Supervisor, {robot, given}})
      ] ++ Simulation.children(robot) ++ [{BB.Safety.Latch, robot}, {Topology, {robot, nil}}]

    Supervisor.init(children, strategy: :one_for_one)
  end

  # Before anybody can arm it.
  defp inhibit(robot) do
    for %{module: module, path: path} <- robot.robot().components,
        Code.ensure_loaded?(module) and function_exported?(module, :inhibition, 0),
        do: BB.Safety.inhibit(robot, path, inhibition(module))
  end

  # One that cannot say why the robot may not be armed does not say that it may.
  defp inhibition(module) do
    opts = [
      accept: &small/1,
      expected: "a reason of #{@largest_reason} bytes at most",
      instead: "the robot may not be armed until the component allows it"
    ]

    case Callback.call({module, :inhibition, []}, opts) do
      {:ok, reason} -> reason
      {:error, failure} -> {:inhibition_failed, Callback.words(failure)}
    end
  end

  defp small(reason),
    do: if(:erlang.external_size(reason) <= @largest_reason, do: {:ok, reason}, else: :error)

  defp values(definitions, given),
    do: definitions |> Map.new(&{&1.path, &1.default}) |> Map.merge(given)

  # What a component's own check cannot tell is that component's trouble: it shows at its start.
  defp check(components, robot, values) do
    components
    |> Enum.map(&{Resolution.of(robot, &1), values})
    |> Enum.filter(&known?/1)
    |> Checked.options()
    |> Enum.find(:ok, &match?({:error, %ValidationError{}}, &1))
  end

  # Those of the settings were checked with the declaration.
  defp check_topics(_components, nil), do: :ok

  defp check_topics(components, prefix) do
    Enum.find_value(components, :ok, fn component ->
      Enum.find_value(topics(component), &misnamed(&1, prefix, component.path))
    end)
  end

  defp topics(%{module: module, options: options}) do
    opts = [expected: "a list of names", instead: "its topics are checked when it starts"]

    if Code.ensure_loaded?(module) and function_exported?(module, :topics, 1),
      do: names(Callback.call({module, :topics, [options]}, [accept: &accept_names/1] ++ opts)),
      else: []
  end

  defp names({:ok, names}), do: names
  defp names({:error, _failure}), do: []

  defp accept_names(names),
    do: if(is_list(names) and Enum.all?(names, &is_binary/1), do: {:ok, names}, else: :error)

  defp misnamed(name, prefix, path) do
    with {:error, why} <- Topic.resolve(name, prefix),
         do:
           {:error,
            %ValidationError{message: why, key: :topic_prefix, value: prefix, keys_path: path}},
         else: (_ok -> nil)
  end

  # A parameter without a default may have a persisted value.
  defp known?({resolution, values}),
    do: Enum.all?(Resolution.paths(resolution), &(values[&1] != nil))
end
