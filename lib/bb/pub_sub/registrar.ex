defmodule BB.PubSub.Registrar do
  @moduledoc """
  The process that writes the subscriptions of a pubsub, and the routes that publishers read.

  `BB.PubSub` calls it to subscribe, to unsubscribe and to retain a prefix. No message passes
  through it. It answers a subscriber when no publisher can miss it any more:

    1. It outdates the routes of all streams that the subscription reaches, by raising a number in
       their meters (`BB.PubSub.Meter`). From then on publishers look up the subscriptions.
    2. It writes the subscription.
    3. It answers the subscriber.

  Publishing new routes is the expensive part: the VM searches all processes for references to the
  old ones. So the registrar waits for some milliseconds to combine changes, and spends at most a
  tenth of its time on routes. No subscriber waits for them, however many subscribers and new
  streams there are. Streams with more than a few hundred subscribers get no route: copying such a
  list at each change would cost more than it saves.

  It monitors the subscribers and removes those that die. It is not linked to them. When the
  registrar itself dies, nothing is lost: the tables belong to the process that started the
  pubsub, publishers use the routes they have, subscribers wait a moment, and the next registrar
  continues from the tables.
  """

  @moduledoc no_example: "internal: BB.PubSub is its interface"

  use GenServer
  use BB.Process.Tolerant

  alias BB.Path

  alias BB.PubSub.{
    Bus,
    Cells,
    Delivery,
    Meter,
    Plan,
    Retention,
    Routes,
    Statistics,
    Streams,
    Subscribers,
    Subscription,
    Subscriptions
  }

  @combine_ms 5
  @most_routed 500
  @most_targets_at_once 20_000
  # Publishing routes costs each process of the VM some time that no clock here measures.
  @processes_per_ms 500

  @enforce_keys [:bus, :routes, :subscribers]
  defstruct [
    :bus,
    :routes,
    :subscribers,
    :timer,
    # Permanent streams with their meters.
    streams: %{},
    # The paths whose routes are outdated already.
    outdated: %{},
    # The paths whose routes are to be rebuilt.
    dirty: %{},
    # The earliest time for new routes.
    next_flush_ms: nil
  ]

  @doc """
  Starts the pubsub of a robot.

  Its tables belong to the caller. Tables that the caller has already are used again.
  """
  @spec start_link(module(), module()) :: GenServer.on_start()
  def start_link(robot, name) do
    case Process.whereis(name) do
      nil -> GenServer.start_link(__MODULE__, Bus.open(robot, name), name: name)
      pid -> {:error, {:already_started, pid}}
    end
  end

  @doc "Adds a subscription."
  @spec subscribe(Bus.t(), Subscription.t()) :: {:ok, pid()}
  def subscribe(bus, subscription), do: call(bus, {:subscribe, subscription})

  @doc """
  Removes the subscriptions of a process at a path.

  Returns `:ok` also if the pubsub has ended.
  """
  @spec unsubscribe(Bus.t(), pid(), Path.t()) :: :ok
  def unsubscribe(bus, pid, path) do
    call(bus, {:unsubscribe, pid, path})
  rescue
    ArgumentError -> :ok
  end

  @doc """
  Keeps the last messages at and below a prefix from now on.

  Returns `{:error, most}` if there are as many prefixes already.
  """
  @spec retain(Bus.t(), Path.t()) :: :ok | {:error, pos_integer()}
  def retain(bus, prefix), do: call(bus, {:retain, prefix})

  @attempts 1_000

  # While the registrar restarts, calls are only late. A request that is repeated is recognized by
  # the id of its subscription.
  defp call(bus, request, left \\ @attempts) do
    GenServer.call(bus.registrar, {request, left < @attempts}, :infinity)
  catch
    :exit, {reason, _} when left > 0 and reason in [:noproc, :killed, :shutdown, :normal] ->
      _ = Bus.fetch!(bus.robot)
      Process.sleep(1)
      call(bus, request, left - 1)
  end

  @impl GenServer
  def init(bus) do
    Process.flag(:trap_exit, true)

    state = %__MODULE__{
      bus: bus,
      routes: Bus.routes(bus),
      streams: Map.new(Streams.permanent(bus)),
      subscribers:
        bus |> Subscriptions.all() |> Enum.reduce(Subscribers.new(), &Subscribers.track(&2, &1))
    }

    outdate_all(state.streams)
    {:ok, mark_dirty(state, [])}
  end

  @impl GenServer
  def handle_call({{:subscribe, subscription}, repeated?}, _from, state) do
    if repeated? and Subscriptions.member?(state.bus, subscription),
      do: {:reply, {:ok, self()}, state},
      else: {:reply, {:ok, self()}, add(state, subscription)}
  end

  def handle_call({{:unsubscribe, pid, path}, _repeated?}, _from, state) do
    if Subscriptions.at?(state.bus, pid, path),
      do: {:reply, :ok, state |> outdate_routes(path) |> remove(pid, path) |> demonitor(pid)},
      else: {:reply, :ok, state}
  end

  def handle_call({{:retain, prefix}, _repeated?}, _from, state) do
    case Bus.retain(state.bus, prefix) do
      {:ok, bus} when bus == state.bus -> {:reply, :ok, state}
      {:ok, bus} -> {:reply, :ok, publish_retained(%{state | bus: bus}, prefix)}
      {:error, most} -> {:reply, {:error, most}, state}
    end
  end

  @impl GenServer
  def handle_cast({:new_stream, path, type}, %{streams: streams} = state) do
    stream = {path, type}

    if is_map_key(streams, stream) do
      {:noreply, state}
    else
      {_class, meter} = Streams.fetch(state.bus, path, type)
      {:noreply, mark_dirty(%{state | streams: Map.put(streams, stream, meter)}, path)}
    end
  end

  @impl GenServer
  def handle_info(:flush, state), do: {:noreply, flush(%{state | timer: nil})}

  def handle_info({:DOWN, _ref, :process, pid, _reason}, state) do
    paths = Subscriptions.paths(state.bus, pid)
    state = %{state | subscribers: Subscribers.delete_monitor(state.subscribers, pid)}
    {:noreply, Enum.reduce(paths, state, &remove(&2, pid, &1))}
  end

  @impl GenServer
  def terminate(reason, state) do
    if shutdown?(reason) or not Bus.owned?(state.bus), do: Bus.close(state.bus)
  end

  defp shutdown?({:shutdown, _}), do: true
  defp shutdown?(reason), do: reason in [:normal, :shutdown]

  # Subscriptions

  defp add(state, %{pid: pid, path: path} = subscription) do
    state = outdate_routes(state, path)

    if subscription.unique or Subscribers.unique?(state.subscribers, pid) do
      :ok = change_unique(state, pid, fn -> Subscriptions.add(state.bus, subscription) end)
    else
      :ok = Subscriptions.add(state.bus, subscription)
      :ok = Statistics.correct(state.streams, [subscription], %{})
    end

    mark_dirty(%{state | subscribers: Subscribers.track(state.subscribers, subscription)}, path)
  end

  defp remove(state, pid, path) do
    remove = fn -> Subscriptions.remove(state.bus, pid, path) end

    unique? = Subscribers.unique?(state.subscribers, pid)
    removed = if unique?, do: change_unique(state, pid, remove), else: remove.()
    Enum.each(removed, &Cells.delete(state.bus, &1))

    left = if unique?, do: Subscriptions.of(state.bus, pid), else: []
    subscribers = Subscribers.untrack(state.subscribers, pid, path, removed, left)
    mark_dirty(%{state | subscribers: subscribers}, path)
  end

  defp demonitor(state, pid) do
    if Subscriptions.anywhere?(state.bus, pid),
      do: state,
      else: %{state | subscribers: Subscribers.demonitor(state.subscribers, pid)}
  end

  # A change at a process with a unique subscription changes the shares of its other ones too.
  defp change_unique(state, pid, fun) do
    before = Statistics.shares(state.streams, Subscriptions.of(state.bus, pid))
    result = fun.()
    Statistics.correct(state.streams, Subscriptions.of(state.bus, pid), before)
    result
  end

  # Routes

  # Publishers see the prefix at once; the routes made without it are outdated.
  defp publish_retained(state, prefix) do
    state = outdate_routes(state, prefix)
    Bus.publish(state.bus, state.routes)
    mark_dirty(state, prefix)
  end

  # A `:persistent_term.put/2` takes effect even if its process is killed in it. So the VM may
  # publish the routes of a killed predecessor after this process has read the present ones.
  defp outdate_all(streams),
    do: Enum.each(streams, fn {_stream, meter} -> Meter.outdate(meter) end)

  # Once is enough until there are new routes.
  defp outdate_routes(%{outdated: outdated} = state, path) when is_map_key(outdated, path),
    do: state

  defp outdate_routes(state, path) do
    for {{stream_path, type}, meter} <- state.streams,
        Path.prefix?(path, stream_path),
        {_, _, _, _, version, _} <- [Routes.find(state.routes, stream_path, type)],
        Meter.version(meter) == version,
        do: Meter.outdate(meter)

    %{state | outdated: Map.put(state.outdated, path, true)}
  end

  defp mark_dirty(state, path),
    do: schedule_flush(%{state | dirty: Map.put(state.dirty, path, true)})

  defp schedule_flush(%{timer: nil} = state) do
    wait_ms = (state.next_flush_ms || 0) - System.monotonic_time(:millisecond)
    after_ms = if state.next_flush_ms, do: max(wait_ms, @combine_ms), else: @combine_ms
    %{state | timer: Process.send_after(self(), :flush, after_ms)}
  end

  defp schedule_flush(state), do: state

  defp flush(state) do
    start_ms = System.monotonic_time(:millisecond)
    {now, later} = state |> dirty_streams() |> split(state, @most_targets_at_once)
    routes = Enum.reduce(now, state.routes, &put_route(state, &1, &2))
    if now != [], do: Bus.publish(state.bus, routes)
    dirty = Map.new(later, fn {{path, _type}, _meter} -> {path, true} end)

    postpone_flush(%{state | routes: routes, outdated: %{}, dirty: dirty}, start_ms)
  end

  # A stream that has no route and gets none is not dirty.
  defp dirty_streams(%{dirty: dirty} = state) do
    for {{path, type}, _meter} = stream <- state.streams,
        is_map_key(dirty, path) or Enum.any?(Path.ancestors(path), &is_map_key(dirty, &1)),
        not crowded?(state, path) or Routes.find(state.routes, path, type) != nil,
        do: stream
  end

  # Takes as many streams as can be routed before a waiting subscriber would notice.
  defp split([stream | rest], state, left) when left > 0 do
    {{path, _type}, _meter} = stream

    {now, later} =
      split(rest, state, left - 10 - Subscribers.count_reached(state.subscribers, path))

    {[stream | now], later}
  end

  defp split(later, _state, _left), do: {[], later}

  defp put_route(%{bus: bus} = state, {{path, type}, meter}, routes) do
    if crowded?(state, path) do
      Routes.delete(routes, {path, type})
    else
      {steps, _filtered} = Plan.new(Subscriptions.reaching(bus, path), type)
      sequence = if Bus.retained?(bus, path), do: Retention.sequence(bus, path)
      targets = Delivery.targets(bus, steps, path)
      Routes.put(routes, {path, type, meter, targets, Meter.version(meter), sequence})
    end
  end

  defp crowded?(state, path),
    do: Subscribers.count_reached(state.subscribers, path) > @most_routed

  defp postpone_flush(state, start_ms) do
    now_ms = System.monotonic_time(:millisecond)
    cost_ms = now_ms - start_ms + div(:erlang.system_info(:process_count), @processes_per_ms)
    state = %{state | next_flush_ms: now_ms + 10 * cost_ms}
    if state.dirty == %{}, do: state, else: schedule_flush(state)
  end
end
