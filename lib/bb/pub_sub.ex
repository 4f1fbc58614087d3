defmodule BB.PubSub do
  @moduledoc """
  The bus inside a robot: whoever has something to tell publishes it at a path, and whoever subscribed at that path or above
  receives it.

      BB.PubSub.subscribe(MyRobot, [:sensor, :base_link], message_types: [BB.Message.Sensor.Imu])
      BB.PubSub.publish(MyRobot, [:sensor, :base_link, :imu], message)

      receive do
        {:bb, [:sensor, :base_link, :imu], %BB.Message{payload: imu}} -> imu
      end

  What a subscriber receives is `{:bb, source_path, message}`, with the path at which it was published, in full, and the robot
  in the message. The usual paths:

    * `[:sensor | path]` - what sensors measure
    * `[:sensor_status | path]` - how sensors fare
    * `[:actuator | path]`, `[:param | path]`, `[:state_machine]`, `[:safety, :error]`

  ## What it promises

    * There is no process in the middle. Publishing runs in the publisher, which sends to each subscriber itself, so a slow
      subscriber holds up nobody, and a busy path no other.
    * Messages of one publisher reach a subscriber in the order in which they were published, at whatever paths: each `publish/4`
      has sent everything when it returns, and the VM keeps the order of signals from one process to another. Between several
      publishers there is no order.
    * Within one publication the path itself comes first, then its ancestors, nearest first. A process that subscribed twice,
      or at two levels, receives twice.
    * A subscriber that dies is forgotten; `subscribers/2` does not list it from then on.

  It does not promise that a message arrives where nobody listens: a subscriber that comes late has missed what was published
  before. A subscriber that never reads its mailbox fills it.

  The bus of a robot lives as long as the robot: functions raise `ArgumentError` when it is not started.
  """

  alias BB.{Message, Path}

  @type message_types :: [module()]
  @type subscribe_option :: {:message_types, message_types()}
  @type publish_option :: {:except, [pid()]}

  @doc """
  The name of a robot's bus.

      iex> BB.PubSub.registry_name(MyRobot)
      MyRobot.PubSub
  """
  @spec registry_name(module()) :: module()
  def registry_name(robot), do: Module.concat(robot, PubSub)

  @doc "A child specification: `{BB.PubSub, MyRobot}` among a supervisor's children."
  @spec child_spec(module()) :: Supervisor.child_spec()
  def child_spec(robot) do
    %{id: {__MODULE__, robot}, start: {__MODULE__, :start_link, [robot]}, type: :supervisor}
  end

  @doc "Starts a robot's bus."
  @spec start_link(module()) :: {:ok, pid()} | {:error, term()}
  def start_link(robot) when is_atom(robot),
    do: Registry.start_link(keys: :duplicate, name: registry_name(robot))

  @doc """
  Subscribes the calling process to a path and everything below it.

  Options:

    * `:message_types` - payload modules; only messages with one of these payloads are delivered. `[]`, the default, is all

  Each call makes one subscription more. Returns `{:ok, pid}`, the pid of the bus.
  """
  @spec subscribe(module(), Path.t(), [subscribe_option()]) :: {:ok, pid()} | {:error, term()}
  def subscribe(robot, path, opts \\ []) do
    types = option!(opts, :message_types, "subscribe", "a list of payload modules", &is_atom/1)
    Registry.register(started!(robot), Path.validate!(path), types)
  end

  @doc "Removes all subscriptions that the calling process has at exactly this path; `:ok` also when there are none."
  @spec unsubscribe(module(), Path.t()) :: :ok
  def unsubscribe(robot, path) do
    case started(robot) do
      {:ok, registry} -> Registry.unregister(registry, Path.validate!(path))
      :error -> :ok
    end
  end

  @doc """
  Delivers a message to the subscribers at the path and at each of its ancestors. Always `:ok`.

  Options:

    * `:except` - pids that do not receive it, for example the publisher itself
  """
  @spec publish(module(), Path.t(), Message.t(), [publish_option()]) :: :ok
  def publish(robot, path, message, opts \\ [])

  def publish(robot, path, %Message{} = message, opts) do
    registry = started!(robot)
    except = option!(opts, :except, "publish", "a list of pids", &is_pid/1)
    delivery = {:bb, Path.validate!(path), %{message | robot: robot}}
    Enum.each(ancestor_paths(path), &deliver(registry, &1, delivery, except))
  end

  def publish(_robot, _path, message, _opts) do
    raise ArgumentError, "what is published is a %BB.Message{}, got: #{inspect(message)}"
  end

  @doc "The subscriptions at exactly this path, `{pid, message_types}` each."
  @spec subscribers(module(), Path.t()) :: [{pid(), message_types()}]
  def subscribers(robot, path) do
    for {pid, _} = subscription <- Registry.lookup(started!(robot), Path.validate!(path)),
        Process.alive?(pid),
        do: subscription
  end

  @doc false
  def ancestor_paths(path), do: [path | Path.ancestors(path)]

  defp deliver(registry, path, {:bb, _, message} = delivery, except) do
    type = message.payload.__struct__

    for {pid, types} <- Registry.lookup(registry, path),
        types == [] or type in types,
        pid not in except,
        do: send(pid, delivery)
  end

  defp started!(robot) do
    case started(robot) do
      {:ok, registry} ->
        registry

      :error ->
        raise ArgumentError,
              "the robot #{inspect(robot)} is not started: start it under a supervisor or with #{inspect(robot)}.start_link() first"
    end
  end

  defp started(robot) when is_atom(robot) do
    registry = registry_name(robot)
    if Process.whereis(registry), do: {:ok, registry}, else: :error
  end

  defp started(robot), do: raise(ArgumentError, "a robot is a module, got: #{inspect(robot)}")

  # The value of the one option that a function takes, a list of something; [] when it is not given.
  defp option!([], _key, _function, _what, _valid?), do: []

  defp option!([{key, list}], key, function, what, valid?) do
    if is_list(list) and Enum.all?(list, valid?),
      do: list,
      else: raise(ArgumentError, "#{key}: of #{function} is #{what}, got: #{inspect(list)}")
  end

  defp option!(opts, key, function, _what, _valid?),
    do: raise(ArgumentError, "#{function} takes the option :#{key}, got: #{inspect(opts)}")
end
