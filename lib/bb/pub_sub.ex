defmodule BB.PubSub do
  @moduledoc """
  The pubsub of a robot: processes publish messages at paths, and receive the messages published
  at the paths that they subscribe to and below.

  Use it to receive what sensors measure, to publish from a driver or a controller, and to connect
  parts of a robot that should not name each other:

      iex> {:ok, _pubsub} = BB.PubSub.start_link(DocRobot)
      iex> {:ok, _pubsub} = BB.PubSub.subscribe(DocRobot, [:sensor, :base_link])
      iex> fields = [voltage: 11.8, current: -0.4]
      iex> message = BB.Message.new!(BB.Message.Sensor.PowerState, :battery, fields)
      iex> BB.PubSub.publish(DocRobot, [:sensor, :base_link, :battery], message)
      :ok
      iex> receive do
      ...>   {:bb, path, %BB.Message{robot: DocRobot} = m} -> {path, m.payload.voltage}
      ...> end
      {[:sensor, :base_link, :battery], 11.8}

  A subscriber receives `{:bb, path, message}`: the full path at which the message was published,
  and the message with the robot in it. The usual paths are:

    * `[:sensor | path]` - the readings of sensors
    * `[:sensor_status | path]` - the status of sensors
    * `[:actuator | path]`, `[:param | path]`, `[:state_machine]`, `[:safety, :error]`

  ## Guarantees

    * No process stands between publishers and subscribers. Publishing runs in the publisher,
      which sends to each subscriber itself. A slow subscriber delays no one, and a busy path
      delays no other path.
    * Messages of one publisher reach a subscriber in the order in which they were published, at
      whatever paths: `publish/4` has sent everything when it returns, and the VM keeps the order
      of signals between two processes. Messages of several publishers have no order.
    * Of one message, the subscribers at the path itself get their copies first, then those at its
      ancestors, nearest first. A process that subscribed twice, or at two levels, receives twice.
    * A subscriber that dies is removed, and `subscribers/2` no longer lists it. Subscribers are
      not linked to the pubsub: the end of one ends no other.
    * A publisher waits for no subscriber, with one exception: if the operating system suspends a
      subscriber's thread at the very moment of its replay, a publisher waits once, for at most a
      millisecond.
    * Subscriptions last as long as the robot. They survive the death of every process of the
      pubsub. A process that subscribes at that moment waits until the pubsub has restarted.

  A message at a path without subscribers is lost, except on retained paths. A subscriber that
  never reads its mailbox fills it, unless it subscribed with `max_queue`.

  The pubsub of a robot runs as long as the robot. Functions raise `ArgumentError` when the robot
  is not started.

  ## Options of a subscription

      # A display shows ten messages a second, and only recent ones, however slow it is.
      BB.PubSub.subscribe(MyRobot, [:sensor], max_rate: 10, max_queue: 100)

      # A late subscriber gets the present parameters at once.
      BB.PubSub.subscribe(MyRobot, [:param], replay: true)

  The options of `subscribe/3` can be combined. They cost nothing for subscribers without them.

    * A subscriber with `max_queue` that was skipped gets `{:bb_missed, path, count}` before its
      next message: `count` messages for its subscription at `path` were dropped since the last
      one. `missed/1` returns the sum at any time. A GenServer with this option needs a clause for
      that message in `handle_info/2`. The limit is approximate: a publisher that finds room sends
      up to an eighth of the limit before it checks again.
    * With `unique`, a process gets one copy of a message, even if several of its subscriptions
      match. It gets the copy by the first of them, from the path upwards, that takes the message.
    * `replay` sends the last message of each retained path, which is in the mailbox when
      `subscribe/3` returns, then everything newer once and in order. The other options (type,
      rate, mailbox) apply to replayed messages too.

  ## Retained paths

  The pubsub keeps the last message of each path at and below `[:param]`, `[:state_machine]` and
  `[:sensor_status]`, of sensors declared with `retain: true`, and of prefixes given to
  `retain/2`. `last/2` returns it. One message is kept for each path, whatever its type. A robot
  has at most 1000 retained prefixes; prefixes below another one do not count.

  ## Cost

  Publishing to no subscriber takes about as long as three or four function calls. Otherwise it
  takes little more than a `send/2` for each subscriber. Subscribers at other paths or for other
  types cost nothing (docs/performance.md).

  A publisher looks up the subscribers, which takes some microseconds more,

    * for some milliseconds after a subscription or its end,
    * on the first messages of a path,
    * on transient paths (below),
    * with more than 500 subscribers,
    * with an option of `publish/4`.

  Subscribing takes about ten microseconds, for the ten-thousandth subscriber of a path as for the
  first: memory and time are linear in the number of subscribers.

  ## Limits

  What the pubsub remembers is bounded, whatever is published:

    * A path has at most 64 segments (`BB.Path`). A longer one raises `ArgumentError`.
    * A *stream* is a path with one payload type. The first 4000 streams at paths of atoms are
      remembered as long as the robot runs. Any other path is *transient*: it contains a
      reference, or came later. The newest 1000 transient paths are remembered, and beside them
      the newest 1000 that are retained. When a path is forgotten, its last message is deleted,
      its count restarts at 0, and a subscriber with `max_rate` gets its next message at once. The
      pubsub logs once that it has begun to forget last messages.
  """

  require BB.PubSub.Meter

  alias BB.{Message, Options, Path}

  alias BB.PubSub.{
    Bus,
    Delivery,
    Meter,
    QueueLimit,
    Registrar,
    Retention,
    Routes,
    Statistics,
    Streams,
    Subscription,
    Subscriptions
  }

  @type message_types :: [module()]
  @type subscribe_option ::
          {:message_types, message_types()}
          | {:max_rate, number()}
          | {:replay, boolean()}
          | {:exact, boolean()}
          | {:unique, boolean()}
          | {:max_queue, non_neg_integer()}
  @type publish_option :: {:except, [pid() | :undefined]}

  @publish_schema Options.new!(
                    except: [type: {:list, {:or, [:pid, {:literal, :undefined}]}}, default: []]
                  )

  @doc """
  Returns the name of a robot's pubsub.

      iex> BB.PubSub.registry_name(MyRobot)
      MyRobot.PubSub
  """
  @spec registry_name(module()) :: module()
  def registry_name(robot), do: Module.concat(robot, PubSub)

  @doc "Returns the child specification for `{BB.PubSub, MyRobot}` in a supervisor's children."
  @spec child_spec(module()) :: Supervisor.child_spec()
  def child_spec(robot),
    do: %{id: {__MODULE__, robot}, start: {__MODULE__, :start_link, [robot]}}

  @doc """
  Starts a robot's pubsub.

  Its tables belong to the calling process, a supervisor. When the pubsub is killed and the
  supervisor restarts it, all subscriptions are kept.
  """
  @spec start_link(module()) :: {:ok, pid()} | {:error, term()}
  def start_link(robot) when is_atom(robot),
    do: Registrar.start_link(robot, registry_name(robot))

  @doc """
  Subscribes the calling process to a path and all paths below it.

  Each call adds a subscription. Returns `{:ok, pid}` with the pid of the pubsub. Every message
  published from then on arrives.

  ## Options

  #{Options.docs(Subscription.schema())}
  """
  @spec subscribe(module(), Path.t(), [subscribe_option()]) :: {:ok, pid()} | {:error, term()}
  def subscribe(robot, path, opts \\ []) do
    bus = Bus.fetch!(robot)
    subscription = Subscription.new(path, opts)
    result = Registrar.subscribe(bus, subscription)
    Retention.replay(bus, subscription)
    result
  end

  @doc """
  Removes all subscriptions of the calling process at exactly this path.

  Returns `:ok` also when there are none.
  """
  @spec unsubscribe(module(), Path.t()) :: :ok
  def unsubscribe(robot, path) do
    case {Path.validate!(path), Bus.fetch(robot)} do
      {path, {:ok, bus}} -> Registrar.unsubscribe(bus, self(), path)
      {_path, :error} -> :ok
    end
  end

  @doc """
  Publishes a message to the subscribers at the path and at each of its ancestors. Returns `:ok`.

  ## Options

    * `:except` - the pids that do not receive the message, such as the publisher's own. An
      `:undefined`, as `BB.Process.whereis/2` returns for a component that is down, stands for
      no process.
  """
  @spec publish(module(), Path.t(), Message.t(), [publish_option()]) :: :ok
  def publish(robot, path, message, opts \\ [])

  def publish(
        robot,
        path,
        %Message{payload: %{__struct__: type}, monotonic_time: time} = message,
        []
      )
      when is_integer(time) do
    with {Bus, routes, _bus} <- :persistent_term.get(robot, nil),
         {_, _, meter, targets, version, nil} <- Routes.find(routes, path, type) do
      if meter |> Meter.tick(time) |> Meter.current?(version),
        do: send_all(targets, path, message, robot),
        else: publish_outdated(robot, path, type, message)
    else
      _ -> publish_general(robot, path, type, message, [])
    end
  end

  def publish(robot, path, %Message{payload: %{__struct__: type}} = message, opts),
    do: publish_general(robot, path, type, message, except!(opts))

  def publish(_robot, _path, %Message{payload: payload}, _opts) do
    raise ArgumentError,
          "expected a %BB.Message{} with a struct as its payload, got the payload: " <>
            "#{inspect(payload)}; create messages with BB.Message.new!/3"
  end

  def publish(_robot, _path, message, _opts) do
    raise ArgumentError,
          "expected a %BB.Message{}, got: #{inspect(message)}; create one with BB.Message.new!/3"
  end

  defp send_all([], _path, _message, _robot), do: :ok

  defp send_all(targets, path, message, robot),
    do: Delivery.deliver(targets, {:bb, path, %{message | robot: robot}}, nil)

  # Subscriptions or retained prefixes have changed, and there is no new route yet.
  defp publish_outdated(robot, path, type, message) do
    deliver_unrouted(Bus.fetch!(robot), {path, type, :permanent}, %{message | robot: robot}, [])
  end

  # With an option, on a retained path, or without a route.
  defp publish_general(robot, path, type, message, except) do
    bus = Bus.fetch!(robot)
    message = %{message | robot: robot}

    case except == [] && route(robot, path, type) do
      {_, _, _, _, _, sequence} = route when sequence != nil ->
        publish_retained(bus, route, message)

      _ ->
        publish_unrouted(bus, Path.validate!(path), type, message, except)
    end
  end

  defp route(robot, path, type) do
    case :persistent_term.get(robot, nil) do
      {Bus, routes, _bus} -> Routes.find(routes, path, type)
      _ -> nil
    end
  end

  # The message is kept before the route's version is checked. So a subscriber that comes too late
  # for the route gets the message by its replay.
  defp publish_retained(bus, {path, type, meter, targets, version, sequence}, message) do
    stamp = Retention.put(bus, path, message, sequence)
    delivery = {:bb, path, message}

    if meter |> Meter.count(message.monotonic_time) |> Meter.current?(version),
      do: Delivery.deliver(targets, delivery, stamp),
      else: Delivery.unrouted(bus, {path, type, :permanent}, [], delivery, stamp)
  end

  # The registrar makes a route for a new permanent stream.
  defp publish_unrouted(bus, path, type, message, except) do
    {class, meter} = Streams.fetch(bus, path, type)
    _word = Meter.count(meter, message.monotonic_time)
    deliver_unrouted(bus, {path, type, class}, message, except)
  end

  defp deliver_unrouted(bus, {path, _type, _class} = stream, message, except) do
    stamp = if Bus.retained?(bus, path), do: Retention.put(bus, path, message)
    Delivery.unrouted(bus, stream, except, {:bb, path, message}, stamp)
  end

  defp except!(except: []), do: []

  defp except!(opts) do
    case Options.validate(opts, @publish_schema) do
      {:ok, opts} -> opts[:except]
      {:error, error} -> raise ArgumentError, Exception.message(error)
    end
  end

  @doc "Returns the subscriptions at exactly this path as `{pid, message_types}`."
  @spec subscribers(module(), Path.t()) :: [{pid(), message_types()}]
  def subscribers(robot, path) do
    for %{pid: pid} = subscription <- Subscriptions.at(Bus.fetch!(robot), Path.validate!(path)),
        Process.alive?(pid),
        do: {pid, subscription.message_types}
  end

  @doc """
  Keeps the last message of each path at and below `prefix` from now on, for `last/2` and
  `replay: true`.

  Messages at `[:param]`, `[:state_machine]` and `[:sensor_status]`, and those of sensors declared
  with `retain: true`, are always kept. A robot can have 1000 prefixes; one more raises
  `ArgumentError`.
  """
  @spec retain(module(), Path.t()) :: :ok
  def retain(robot, prefix) do
    with {:error, most} <- Registrar.retain(Bus.fetch!(robot), Path.validate!(prefix)) do
      raise ArgumentError,
            "expected at most #{most} retained prefixes, got one more: #{inspect(prefix)}; " <>
              "retain a prefix of several paths instead"
    end
  end

  @doc """
  Returns the last message published at exactly this path if it is retained, otherwise `nil`.
  """
  @spec last(module(), Path.t()) :: Message.t() | nil
  def last(robot, path), do: Retention.last(Bus.fetch!(robot), Path.validate!(path))

  @doc """
  Returns how many messages the calling process missed because of `max_queue` since it subscribed.
  """
  @spec missed(module()) :: non_neg_integer()
  def missed(robot) do
    subscriptions = Subscriptions.of(Bus.fetch!(robot), self())
    Enum.sum(for %{counters: counters} <- subscriptions, do: QueueLimit.missed(counters))
  end

  @doc """
  Returns the streams that the pubsub remembers, sorted by path.

  A stream is a path with one payload type that was published there. Each is a map:

    * `path`, `type` - the path and the payload's module
    * `count` - the number of messages
    * `rate_hz` - the messages per second, over the last sixteen; it falls when the next one is
      overdue
    * `age_ns` - the age of the last message

  Rate and age are calculated from the messages' `monotonic_time`, the time of measurement. At
  most 6000 streams are remembered, see "Limits".
  """
  @spec topics(module()) :: [Streams.topic()]
  def topics(robot),
    do: Streams.topics(Bus.fetch!(robot), :erlang.monotonic_time(:nanosecond))

  @doc """
  Returns every subscription with the numbers of its messages.

  Each row has:

    * `pid`, `path`, `message_types` - the subscription
    * `delivered` - sent to the subscriber
    * `dropped` - dropped by `max_rate` or `max_queue`
    * `filtered` - of another type, replayed before, or left out by `unique`

  Messages withheld by the publisher's `except` count as none of these. On permanent paths,
  deliveries are not counted while messages are published: this function calculates the numbers
  from the counts of the streams. A message published at the very moment of subscribing may count
  as before or after it.
  """
  @spec stats(module()) :: [Statistics.row()]
  def stats(robot), do: Statistics.rows(Bus.fetch!(robot))

  @doc false
  def ancestor_paths(path), do: [path | Path.ancestors(path)]
end
