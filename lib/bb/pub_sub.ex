defmodule BB.PubSub do
  @moduledoc """
  The bus inside a robot: whoever has something to tell publishes it at a path, and whoever
  subscribed at that path or above receives it.

      BB.PubSub.subscribe(MyRobot, [:sensor, :base_link], message_types: [BB.Message.Sensor.Imu])
      BB.PubSub.publish(MyRobot, [:sensor, :base_link, :imu], message)

      receive do
        {:bb, [:sensor, :base_link, :imu], %BB.Message{payload: imu}} -> imu
      end

  What a subscriber receives is `{:bb, source_path, message}`, with the path at which it was
  published, in full, and the robot in the message. The usual paths:

    * `[:sensor | path]` - what sensors measure
    * `[:sensor_status | path]` - how sensors fare
    * `[:actuator | path]`, `[:param | path]`, `[:state_machine]`, `[:safety, :error]`

  ## What it promises

    * There is no process in the middle. Publishing runs in the publisher, which sends to each
      subscriber itself, so a slow subscriber holds up nobody, and a busy path no other.
    * Messages of one publisher reach a subscriber in the order in which they were published, at
      whatever paths: each `publish/4` has sent everything when it returns, and the VM keeps the
      order of signals from one process to another. Between several publishers there is no order.
    * Within one publication the path itself comes first, then its ancestors, nearest first. A
      process that subscribed twice, or at two levels, receives twice.
    * A subscriber that dies is forgotten; `subscribers/2` does not list it from then on.
      Subscribers are not linked to the bus: nobody's end is another's.
    * A publisher waits for nobody, with one exception: a subscriber whose thread the operating
      system takes away in the very moment of its replay costs a publisher a millisecond at most,
      once.
    * Subscriptions last as long as the robot. They survive the death of every process of the bus;
      somebody who subscribes in that moment waits until it is over.

  It does not promise that a message arrives where nobody listens, except on retained paths. A
  subscriber that never reads its mailbox fills it, unless it asked for `max_queue`.

  The bus of a robot lives as long as the robot: functions raise `ArgumentError` when it is not
  started.

  ## What a subscriber may ask for

      # A display wants ten a second, of what is going on now, however slow it is.
      BB.PubSub.subscribe(MyRobot, [:sensor], max_rate: 10, max_queue: 100)

      # Somebody who comes late wants to know the parameters as they are.
      BB.PubSub.subscribe(MyRobot, [:param], replay: true)

  The options of `subscribe/3` combine freely, and cost those alone who ask for them:

    * A subscriber with `max_queue` that was skipped gets `{:bb_missed, path, count}` before the
      next message that it is sent: since the last one, `count` messages for its subscription at
      `path` went by. `missed/1` tells the sum at any time. A GenServer with this option has a
      clause for that in `handle_info/2`. The limit is approximate: a publisher that found room
      sends up to an eighth of it without looking again.
    * `unique` is about the process: it gets one copy of a message that reaches its unique
      subscription, by the first of its subscriptions, from the path upwards, that takes it.
    * `replay` sends the last message of each retained path at once, in the mailbox when
      `subscribe/3` returns, then everything newer once and in order. The other options hold for
      what is replayed too: type, rate, mailbox.

  ## Retained paths

  The last message of each path at and below `[:param]`, `[:state_machine]` and `[:sensor_status]`
  is kept, as it is of sensors declared with `retain: true` and of what is given to `retain/2`.
  `last/2` reads it. One message is kept for each path, whatever its type. A robot has at most
  1000 prefixes below which messages are kept, apart from prefixes below those.

  ## What it costs

  Publishing to nobody takes about as long as three or four function calls; otherwise it is little
  more than a `send/2` for each subscriber, and subscribers elsewhere or for other types cost
  nothing (docs/performance.md). For some milliseconds after somebody has come or gone, on the
  first messages of a path, on passing paths (below), for more than 500 subscribers and with an
  option, a publisher looks the subscribers up, which takes some microseconds more.

  Subscribing takes some ten microseconds, the same for the ten-thousandth subscriber of a path as
  for the first: memory and time are linear in the number of subscribers.

  ## What it remembers

  All of it is bounded, whatever is published:

    * A path has at most 64 segments (`BB.Path`); a longer one raises `ArgumentError`.
    * The first 4000 sources, a path of atoms with a payload type each, are remembered as long as
      the robot. A path with a reference, or of later sources, is a *passing* one: the newest 1000
      are remembered, and beside those the newest 1000 retained ones. A path that was forgotten
      has no last message, its count begins at 0, and a subscriber with `max_rate` gets its next
      message. That a last message was forgotten is logged, once.
  """

  require BB.PubSub.Traffic

  alias BB.{Message, Options, Path}

  alias BB.PubSub.{
    Bus,
    Delivery,
    Gate,
    Pages,
    Registrar,
    Retention,
    Routes,
    Subscription,
    Traffic
  }

  @type message_types :: [module()]
  @type subscribe_option ::
          {:message_types, message_types()}
          | {:max_rate, number()}
          | {:replay, boolean()}
          | {:exact, boolean()}
          | {:unique, boolean()}
          | {:max_queue, non_neg_integer()}
  @type publish_option :: {:except, [pid()]}

  @publish_schema Options.new!(except: [type: {:list, :pid}, default: []])

  @doc """
  The name of a robot's bus.

      iex> BB.PubSub.registry_name(MyRobot)
      MyRobot.PubSub
  """
  @spec registry_name(module()) :: module()
  def registry_name(robot), do: Module.concat(robot, PubSub)

  @doc "A child specification: `{BB.PubSub, MyRobot}` among a supervisor's children."
  @spec child_spec(module()) :: Supervisor.child_spec()
  def child_spec(robot),
    do: %{id: {__MODULE__, robot}, start: {__MODULE__, :start_link, [robot]}}

  @doc """
  Starts a robot's bus.

  What it knows belongs to the calling process, a supervisor: when the bus is killed and that
  supervisor starts it again, all subscriptions are there.
  """
  @spec start_link(module()) :: {:ok, pid()} | {:error, term()}
  def start_link(robot) when is_atom(robot),
    do: Registrar.start_link(robot, registry_name(robot))

  @doc """
  Subscribes the calling process to a path and everything below it.

  Options:

  #{Options.docs(Subscription.schema())}
  Each call makes one subscription more. Returns `{:ok, pid}`, the pid of the bus: what is
  published from now on arrives.
  """
  @spec subscribe(module(), Path.t(), [subscribe_option()]) :: {:ok, pid()} | {:error, term()}
  def subscribe(robot, path, opts \\ []) do
    bus = Bus.fetch!(robot)
    subscription = Subscription.new(path, opts)
    result = Registrar.subscribe(bus, subscription)
    Retention.replay(bus, subscription)
    result
  end

  @doc "Removes all subscriptions that the calling process has at exactly this path; `:ok` also when there are none."
  @spec unsubscribe(module(), Path.t()) :: :ok
  def unsubscribe(robot, path) do
    case {Path.validate!(path), Bus.fetch(robot)} do
      {path, {:ok, bus}} -> Registrar.unsubscribe(bus, self(), path)
      {_path, :error} -> :ok
    end
  end

  @doc """
  Delivers a message to the subscribers at the path and at each of its ancestors. Always `:ok`.

  Options:

    * `:except` - pids that do not receive it, for example the publisher itself
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
    with {__MODULE__, routes, _bus} <- :persistent_term.get(robot, nil),
         {_, _, meter, targets, version, nil} <- Routes.find(routes, path, type) do
      if meter |> Traffic.tick(time) |> Traffic.current?(version),
        do: send_all(targets, path, message, robot),
        else: publish_outdated(robot, path, type, message)
    else
      _ -> publish_otherwise(robot, path, type, message, [])
    end
  end

  def publish(robot, path, %Message{payload: %{__struct__: type}} = message, opts),
    do: publish_otherwise(robot, path, type, message, except!(opts))

  def publish(_robot, _path, %Message{payload: payload}, _opts) do
    raise ArgumentError, "the payload of what is published is a struct, got: #{inspect(payload)}"
  end

  def publish(_robot, _path, message, _opts) do
    raise ArgumentError, "what is published is a %BB.Message{}, got: #{inspect(message)}"
  end

  defp send_all([], _path, _message, _robot), do: :ok

  defp send_all(targets, path, message, robot),
    do: Delivery.deliver(targets, {:bb, path, %{message | robot: robot}}, nil)

  # Somebody has come or gone, or messages are kept from now on, and there is no new route yet.
  defp publish_outdated(robot, path, type, message) do
    deliver_unrouted(Bus.fetch!(robot), {path, type, :lasting}, %{message | robot: robot}, [])
  end

  # With an option, on a retained path, or where there is no route.
  defp publish_otherwise(robot, path, type, message, except) do
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
      {__MODULE__, routes, _bus} -> Routes.find(routes, path, type)
      _ -> nil
    end
  end

  # The message is kept, and only then it is seen whether the route is that of all who are
  # subscribed: so whoever comes too late for the message gets it by a replay.
  defp publish_retained(bus, {path, type, meter, targets, version, sequence}, message) do
    number = Retention.keep(bus, path, message, sequence)
    delivery = {:bb, path, message}

    if meter |> Traffic.count(message.monotonic_time) |> Traffic.current?(version),
      do: Delivery.deliver(targets, delivery, number),
      else: Delivery.unrouted(bus, {path, type, :lasting}, [], delivery, number)
  end

  # The registrar hears of a source that lasts, and soon there is a route.
  defp publish_unrouted(bus, path, type, message, except) do
    {class, meter} = Traffic.source(bus, path, type)
    _word = Traffic.count(meter, message.monotonic_time)
    deliver_unrouted(bus, {path, type, class}, message, except)
  end

  defp deliver_unrouted(bus, {path, _type, _class} = source, message, except) do
    number = if Bus.retained?(bus, path), do: Retention.keep(bus, path, message)
    Delivery.unrouted(bus, source, except, {:bb, path, message}, number)
  end

  defp except!(except: []), do: []

  defp except!(opts) do
    case Options.validate(opts, @publish_schema) do
      {:ok, opts} -> opts[:except]
      {:error, error} -> raise ArgumentError, Exception.message(error)
    end
  end

  @doc "The subscriptions at exactly this path, `{pid, message_types}` each."
  @spec subscribers(module(), Path.t()) :: [{pid(), message_types()}]
  def subscribers(robot, path) do
    for %{pid: pid} = subscription <- Pages.at(Bus.fetch!(robot), Path.validate!(path)),
        Process.alive?(pid),
        do: {pid, subscription.message_types}
  end

  @doc """
  Keeps the last message of each source at and below `prefix` from now on, for `last/2` and
  `replay: true`.

  `[:param]`, `[:state_machine]` and `[:sensor_status]` are always kept, and so are the messages
  of sensors that are declared with `retain: true`. A robot can have 1000 prefixes; one more
  raises `ArgumentError`.
  """
  @spec retain(module(), Path.t()) :: :ok
  def retain(robot, prefix) do
    with {:error, most} <- Registrar.retain(Bus.fetch!(robot), Path.validate!(prefix)) do
      raise ArgumentError,
            "a robot has at most #{most} retained prefixes, got one more: #{inspect(prefix)}; " <>
              "retain a prefix of several paths instead"
    end
  end

  @doc "The last message that was published at exactly this path, if it is a retained one; otherwise `nil`."
  @spec last(module(), Path.t()) :: Message.t() | nil
  def last(robot, path), do: Retention.last(Bus.fetch!(robot), Path.validate!(path))

  @doc """
  How many messages the calling process did not get because of `max_queue`, since it subscribed.
  """
  @spec missed(module()) :: non_neg_integer()
  def missed(robot) do
    subscriptions = Pages.of(Bus.fetch!(robot), self())
    Enum.sum(for %{counters: counters} <- subscriptions, do: Gate.missed(counters))
  end

  @doc """
  Every source seen: each path with each payload type that was published there, sorted by path.

    * `path`, `type`
    * `count` - how many messages
    * `rate_hz` - messages a second, over the last sixteen; it falls when the next one is overdue
    * `age_ns` - how old the last message is

  Rate and age go by the messages' own `monotonic_time`, when they were measured. At most 6000 are
  remembered, see "What it remembers".
  """
  @spec topics(module()) :: [Traffic.topic()]
  def topics(robot),
    do: Traffic.topics(Bus.fetch!(robot), :erlang.monotonic_time(:nanosecond))

  @doc """
  Every subscription, and what became of the messages that its path heard of since:

    * `pid`, `path`, `message_types`
    * `delivered`
    * `dropped` - by `max_rate` or `max_queue`
    * `filtered` - of another type, replayed before, or the further copies that `unique` spares

  What the publisher's `except` withheld is none of these. Nobody counts deliveries while messages
  are published on paths that last: the figures are worked out here, from the sources' counts. One
  that is published in the very moment of subscribing may be counted on the wrong side.
  """
  @spec stats(module()) :: [Traffic.row()]
  def stats(robot), do: Traffic.stats(Bus.fetch!(robot))

  @doc false
  def ancestor_paths(path), do: [path | Path.ancestors(path)]
end
