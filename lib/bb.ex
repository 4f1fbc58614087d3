defmodule BB do
  @moduledoc """
  Robots: what they sense, who listens, and what keeps them running.

  `use BB` makes a module a robot. It imports the DSL (`BB.Dsl`) and defines:

    * `robot/0` - the declaration as data, a `BB.Robot`
    * `start_link/0,1` - starts the robot's processes (`BB.Supervisor`), registered under the module's name; `params:` sets
      parameters (`BB.Parameter`), `topic_prefix:` goes before the names of its ring topics (`BB.Topic`)
    * `child_spec/0,1` - for a place under a supervisor

  A wrong option of a component, or a wrong parameter, fails the start with `{:error, %BB.Options.ValidationError{}}`, whose
  `Exception.message/1` names the option and its place. Everything that the world does wrong (an absent device, a crash,
  an unplugged wire) leaves the robot running; `BB.Sensor.health/1` tells about it.

  The functions of this module are the everyday face of `BB.PubSub` and of a robot's processes; `robot` is always the
  robot's module.
  """

  @call_timeout_ms 5_000

  defmacro __using__(opts) do
    if opts != [],
      do: raise(ArgumentError, "`use BB` takes no options, got: #{Macro.to_string(opts)}")

    place = Macro.escape(%{file: __CALLER__.file, line: __CALLER__.line})

    quote do
      import BB.Dsl.Robot, warn: false
      BB.Dsl.Builder.start(__MODULE__, unquote(place))
      @before_compile BB.Dsl

      @doc "A place for the robot under a supervisor."
      def child_spec(opts \\ []),
        do: %{id: __MODULE__, start: {__MODULE__, :start_link, [opts]}, type: :supervisor}

      @doc "Starts the robot. See `BB.Supervisor.start_link/2`."
      def start_link(opts \\ []), do: BB.Supervisor.start_link(__MODULE__, opts)
    end
  end

  @doc "Subscribes the calling process to a path and all below it. See `BB.PubSub.subscribe/3`."
  defdelegate subscribe(robot, path, opts \\ []), to: BB.PubSub

  @doc "Ends the caller's subscriptions at exactly that path. See `BB.PubSub.unsubscribe/2`."
  defdelegate unsubscribe(robot, path), to: BB.PubSub

  @doc "Publishes a message on a path. See `BB.PubSub.publish/4`."
  defdelegate publish(robot, path, message, opts \\ []), to: BB.PubSub

  @doc """
  The ring topic of a name that the robot's components declare: with the robot's prefix (`BB.Topic`).

  Raises `ArgumentError` when that is no topic's name.
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

  Exits as `GenServer.call/3` does when the component is down (`:noproc`) or does not reply in time.
  """
  @spec call(module(), atom(), term(), timeout()) :: term()
  def call(robot, name, request, timeout \\ @call_timeout_ms),
    do: GenServer.call(BB.Process.via(robot, name), request, timeout)

  @doc "Casts to a component by its name: `:ok`, also while it is down, when the request is lost."
  @spec cast(module(), atom(), term()) :: :ok
  def cast(robot, name, request), do: GenServer.cast(BB.Process.via(robot, name), request)

  @doc "Sends a message to a component by its name and returns it. While the component is down the message is lost."
  @spec send(module(), atom(), message) :: message when message: term()
  def send(robot, name, message) do
    case BB.Process.whereis(robot, name) do
      :undefined -> message
      pid -> Kernel.send(pid, message)
    end
  end
end
