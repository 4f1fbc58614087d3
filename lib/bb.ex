defmodule BB do
  @moduledoc """
  Makes a module a robot, and reaches the pubsub and the processes of a robot that runs.

  Use it for every robot, and for everyday calls; `BB.PubSub` has all functions of the pubsub. The
  argument `robot` is the robot's module.

      defmodule MyRobot do
        use BB

        topology do
          link :base_link do
            sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1"}
          end
        end
      end

      {:ok, _} = MyRobot.start_link()
      {:ok, _} = BB.subscribe(MyRobot, [:sensor])

  ## `use BB`

  When you `use BB`, the module imports the DSL (`BB.Dsl`) and defines:

    * `robot/0` - returns the declaration as data, a `BB.Robot`
    * `start_link/0,1` - starts the robot's processes, registered under the module's name
      (`BB.Supervisor`). The option `params:` sets parameters (`BB.Parameter`), `topic_prefix:`
      sets the robot's topic prefix (`BB.Topic`), and `simulation: :kinematic` simulates its
      actuators (`BB.Sim.Actuator`)
    * `child_spec/0,1` - returns the child specification of the robot for a supervisor

  ## Errors

  A wrong option of a component or a wrong parameter fails the start with
  `{:error, %BB.Options.ValidationError{}}`. Its message names the option and its place. A fault
  of the world, such as an absent device, a crash or an unplugged wire, leaves the robot
  running; `BB.Sensor.health/1` reports it.
  """

  @call_timeout_ms 5_000

  defmacro __using__(opts) do
    check_options(opts, __CALLER__)
    place = Macro.escape(%{file: __CALLER__.file, line: __CALLER__.line})

    quote do
      import BB.Dsl.Robot, warn: false
      BB.Dsl.Builder.start(__MODULE__, unquote(place))
      @before_compile BB.Dsl
      @before_compile BB

      @doc "Returns the child specification of the robot for a supervisor."
      @spec child_spec(keyword()) :: Supervisor.child_spec()
      def child_spec(opts \\ []),
        do: %{id: __MODULE__, start: {__MODULE__, :start_link, [opts]}, type: :supervisor}

      @doc "Starts the robot. See `BB.Supervisor.start_link/2`."
      @spec start_link(keyword()) :: Supervisor.on_start() | {:error, Exception.t()}
      def start_link(opts \\ []), do: BB.Supervisor.start_link(__MODULE__, opts)
    end
  end

  # After BB.Dsl, which stores the commands.
  @doc false
  defmacro __before_compile__(env) do
    for %{name: name} <- Module.delete_attribute(env.module, :bb_commands) do
      quote do
        @doc """
        Executes the command `#{unquote(inspect(name))}`. See `BB.Robot.Runtime.execute/3`.

        The goal is a keyword list or a map.
        """
        @spec unquote(name)(keyword() | map()) :: {:ok, pid()} | {:error, term()}
        def unquote(name)(goal \\ []),
          do: BB.Robot.Runtime.execute(__MODULE__, unquote(name), Map.new(goal))
      end
    end
  end

  # The DSL has no extensions. Code for Beam Bots may have an empty list of them.
  defp check_options(opts, env) do
    unless Keyword.keyword?(opts) and Enum.all?(opts, &(&1 in [extensions: [], fragments: []])) do
      raise BB.Dsl.Error,
        module: env.module,
        path: [],
        file: env.file,
        line: env.line,
        reason:
          "cannot extend the DSL: expected `use BB` without options, " <>
            "got: #{Macro.to_string(opts)}; remove the options"
    end
  end

  @doc "Subscribes the calling process to a path and all below it. See `BB.PubSub.subscribe/3`."
  @spec subscribe(module(), BB.Path.t(), [BB.PubSub.subscribe_option()]) ::
          {:ok, pid()} | {:error, term()}
  defdelegate subscribe(robot, path, opts \\ []), to: BB.PubSub

  @doc "Ends the caller's subscriptions at exactly that path. See `BB.PubSub.unsubscribe/2`."
  @spec unsubscribe(module(), BB.Path.t()) :: :ok
  defdelegate unsubscribe(robot, path), to: BB.PubSub

  @doc "Publishes a message on a path. See `BB.PubSub.publish/4`."
  @spec publish(module(), BB.Path.t(), BB.Message.t(), [BB.PubSub.publish_option()]) :: :ok
  defdelegate publish(robot, path, message, opts \\ []), to: BB.PubSub

  @doc """
  Returns the name of a ring topic with the robot's topic prefix (`BB.Topic`).

  `name` is the name that a component of the robot declares. Raises `ArgumentError` when the
  result cannot name a topic.
  """
  @spec topic(module(), BB.Topic.name()) :: String.t()
  def topic(robot, name) do
    case BB.Topic.of(robot, name) do
      {:ok, topic} -> topic
      {:error, why} -> raise ArgumentError, why
    end
  end

  @doc """
  Calls a component by its name and returns its reply.

  Exits as `GenServer.call/3` does when the component is down (`:noproc`) or does not reply in
  time.
  """
  @spec call(module(), atom(), term(), timeout()) :: term()
  def call(robot, name, request, timeout \\ @call_timeout_ms),
    do: GenServer.call(BB.Process.via(robot, name), request, timeout)

  @doc """
  Casts a request to a component by its name, and returns `:ok`.

  The request is lost while the component is down.
  """
  @spec cast(module(), atom(), term()) :: :ok
  def cast(robot, name, request), do: GenServer.cast(BB.Process.via(robot, name), request)

  @doc """
  Sends a message to a component by its name, and returns `:ok`.

  The message is lost while the component is down.
  """
  @spec send(module(), atom(), term()) :: :ok
  def send(robot, name, message) do
    case BB.Process.whereis(robot, name) do
      :undefined ->
        :ok

      pid ->
        _ = Kernel.send(pid, message)
        :ok
    end
  end
end
