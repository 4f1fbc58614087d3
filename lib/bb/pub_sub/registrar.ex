defmodule BB.PubSub.Registrar do
  @moduledoc """
  Writes down who is subscribed, and keeps the routes that publishers read. No message goes
  through it.

  It is the one writer of subscriptions and routes. It answers a subscriber when publishers cannot
  miss it any more:

    1. the routes of all sources that reach it are put out of date, a number each
       (`BB.PubSub.Traffic`): publishers look up the subscriptions themselves from now on
    2. the subscription is written down
    3. the subscriber is answered

  Making new routes known is the expensive part: the VM looks through all processes for references
  to the old ones. It waits for some milliseconds, so that changes come together, and it may take
  a tenth of the time at most. No subscriber waits for it, however many there are, and whatever
  new sources publishers come up with. Sources with more than a few hundred subscribers get no
  route: a copy of such a list at each change would cost more than it saves.

  It watches subscribers and removes those that die; it is not linked to them, so that nobody's
  end is another's. When it dies itself, nothing is lost: the tables belong to the process that
  started the bus, publishers go on with the routes that they have, whoever subscribes waits a
  moment, and its successor goes on from the tables.
  """

  use GenServer
  use BB.Process.Tolerant

  alias BB.Path
  alias BB.PubSub.{Bus, Delivery, Gate, Pages, Retention, Routes, Subscription, Traffic}

  @together_ms 5
  @most_routed 500
  @most_at_once 20_000
  # What making routes known costs each process of the VM, which no clock here sees.
  @processes_a_ms 500

  @enforce_keys [:bus, :routes]
  defstruct [
    :bus,
    :routes,
    :timer,
    sources: %{},
    crowds: %{},
    monitors: %{},
    unique: %{},
    outdated: %{},
    dirty: %{},
    rested_ms: nil
  ]

  @doc "Starts the bus of a robot. Its tables belong to the caller, and are taken up again if there are any."
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

  @doc "Removes a process's subscriptions at a path. Those of a bus that has ended ended with it."
  @spec unsubscribe(Bus.t(), pid(), Path.t()) :: :ok
  def unsubscribe(bus, pid, path) do
    call(bus, {:unsubscribe, pid, path})
  rescue
    ArgumentError -> :ok
  end

  @doc """
  Keeps the last messages at and below a prefix from now on; `{:error, most}` when there are as
  many prefixes already.
  """
  @spec retain(Bus.t(), Path.t()) :: :ok | {:error, pos_integer()}
  def retain(bus, prefix), do: call(bus, {:retain, prefix})

  @attempts 1_000

  # While it is being started again its work is only late. A request may be repeated: it is known
  # by its subscription's id.
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
    {BB.PubSub, routes, _bus} = :persistent_term.get(bus.robot)
    state = %__MODULE__{bus: bus, routes: routes, sources: Map.new(Traffic.lasting(bus))}
    outdate_all(state.sources)
    {:ok, bus |> Pages.all() |> Enum.reduce(state, &note(&2, &1)) |> later([])}
  end

  @impl GenServer
  def handle_call({{:subscribe, subscription}, again?}, _from, state) do
    if again? and Pages.member?(state.bus, subscription),
      do: {:reply, {:ok, self()}, state},
      else: {:reply, {:ok, self()}, add(state, subscription)}
  end

  def handle_call({{:unsubscribe, pid, path}, _again?}, _from, state) do
    if Pages.at?(state.bus, pid, path),
      do: {:reply, :ok, state |> outdate(path) |> remove(pid, path) |> unwatch(pid)},
      else: {:reply, :ok, state}
  end

  def handle_call({{:retain, prefix}, _again?}, _from, state) do
    case Bus.retain(state.bus, prefix) do
      {:ok, bus} when bus == state.bus -> {:reply, :ok, state}
      {:ok, bus} -> {:reply, :ok, retain_from_now(%{state | bus: bus}, prefix)}
      {:error, most} -> {:reply, {:error, most}, state}
    end
  end

  @impl GenServer
  def handle_cast({:seen, path, type}, %{sources: sources} = state) do
    source = {path, type}

    if is_map_key(sources, source) do
      {:noreply, state}
    else
      {_class, meter} = Traffic.source(state.bus, path, type)
      {:noreply, later(%{state | sources: Map.put(sources, source, meter)}, path)}
    end
  end

  @impl GenServer
  def handle_info(:flush, state), do: {:noreply, flush(%{state | timer: nil})}

  def handle_info({:DOWN, _ref, :process, pid, _reason}, state) do
    paths = Pages.paths(state.bus, pid)
    state = %{state | monitors: Map.delete(state.monitors, pid)}
    {:noreply, Enum.reduce(paths, state, &remove(&2, pid, &1))}
  end

  @impl GenServer
  def terminate(reason, state) do
    if over?(reason) or not Bus.owned?(state.bus), do: Bus.close(state.bus)
  end

  defp over?({:shutdown, _}), do: true
  defp over?(reason), do: reason in [:normal, :shutdown]

  # Subscriptions

  defp add(state, %{pid: pid, path: path, unique: unique} = subscription) do
    add = fn -> Pages.add(state.bus, subscription) end
    state = outdate(state, path)

    _ =
      if unique or is_map_key(state.unique, pid),
        do: change_all(state, pid, add),
        else: change(state, [], add, fn -> [subscription] end)

    state |> note(subscription) |> later(path)
  end

  defp remove(state, pid, path) do
    remove = fn -> Pages.remove(state.bus, pid, path) end
    gone = if is_map_key(state.unique, pid), do: change_all(state, pid, remove), else: remove.()
    Enum.each(gone, &erase(state.bus, &1))

    state
    |> count(path, -length(gone))
    |> note_unique(pid, gone)
    |> later(path)
  end

  # Changes the subscriptions of a process so that no count changes by it: what was counted before
  # counts for those who were there. Only a process with a unique subscription has others whose
  # share changes.
  defp change_all(state, pid, fun) do
    mine = fn -> Pages.of(state.bus, pid) end
    change(state, mine.(), fun, mine)
  end

  defp change(state, affected, fun, affected_then) do
    before = shares(state, affected)
    result = fun.()
    affected = affected_then.()
    now = shares(state, affected)

    for %{id: id, counters: counters} <- affected do
      {delivered, filtered} = Map.get(before, id, {0, 0})
      {delivered_now, filtered_now} = Map.get(now, id, {0, 0})
      Gate.correct(counters, {delivered - delivered_now, filtered - filtered_now})
    end

    result
  end

  defp shares(_state, []), do: %{}

  defp shares(state, subscriptions) do
    Traffic.shares(state.sources, fn path ->
      Enum.filter(subscriptions, &Subscription.reaches?(&1, path))
    end)
  end

  defp erase(bus, %{id: id} = subscription) do
    if Subscription.gated?(subscription), do: :ets.match_delete(bus.cells, {{id, :_}, :_})
  end

  # What is known of them

  defp note(state, %{pid: pid, path: path, unique: unique}) do
    state = state |> count(path, 1) |> watch(pid)
    if unique, do: %{state | unique: Map.put(state.unique, pid, true)}, else: state
  end

  defp count(state, path, more) do
    case Map.get(state.crowds, path, 0) + more do
      0 -> %{state | crowds: Map.delete(state.crowds, path)}
      count -> %{state | crowds: Map.put(state.crowds, path, count)}
    end
  end

  defp note_unique(state, pid, gone) do
    if Enum.any?(gone, & &1.unique) and not Enum.any?(Pages.of(state.bus, pid), & &1.unique),
      do: %{state | unique: Map.delete(state.unique, pid)},
      else: state
  end

  defp watch(%{monitors: monitors} = state, pid) when is_map_key(monitors, pid), do: state

  defp watch(state, pid),
    do: %{state | monitors: Map.put(state.monitors, pid, Process.monitor(pid))}

  defp unwatch(%{monitors: monitors} = state, pid) do
    if is_map_key(monitors, pid) and not Pages.anywhere?(state.bus, pid) do
      {ref, monitors} = Map.pop(monitors, pid)
      Process.demonitor(ref, [:flush])
      %{state | monitors: monitors}
    else
      state
    end
  end

  # Publishers see the prefix at once; the routes that know nothing of it are out of date.
  defp retain_from_now(state, prefix) do
    state = outdate(state, prefix)
    Bus.publish(state.bus, state.routes)
    later(state, prefix)
  end

  # Routes

  # The VM may make the routes of a killed predecessor known after its end, when these here have
  # been read: a `:persistent_term.put/2` takes effect although its process was killed in it.
  defp outdate_all(sources),
    do: Enum.each(sources, fn {_source, meter} -> Traffic.outdate(meter) end)

  # Once is enough until there are new routes.
  defp outdate(%{outdated: outdated} = state, path) when is_map_key(outdated, path), do: state

  defp outdate(state, path) do
    for {{source, type}, meter} <- state.sources,
        Path.prefix?(path, source),
        {_, _, _, _, version, _} <- [Routes.find(state.routes, source, type)],
        Traffic.version(meter) == version,
        do: Traffic.outdate(meter)

    %{state | outdated: Map.put(state.outdated, path, true)}
  end

  defp later(state, path), do: wake(%{state | dirty: Map.put(state.dirty, path, true)})

  defp wake(%{timer: nil} = state) do
    rest_ms = (state.rested_ms || 0) - System.monotonic_time(:millisecond)
    after_ms = if state.rested_ms, do: max(rest_ms, @together_ms), else: @together_ms
    %{state | timer: Process.send_after(self(), :flush, after_ms)}
  end

  defp wake(state), do: state

  defp flush(state) do
    start_ms = System.monotonic_time(:millisecond)
    {now, then} = state |> dirty_sources() |> split(state, @most_at_once)
    routes = Enum.reduce(now, state.routes, &put_route(state, &1, &2))
    if now != [], do: Bus.publish(state.bus, routes)
    dirty = Map.new(then, fn {{path, _type}, _meter} -> {path, true} end)

    rest(%{state | routes: routes, outdated: %{}, dirty: dirty}, start_ms)
  end

  # Where there was no route and will be none, nothing is to do.
  defp dirty_sources(%{dirty: dirty} = state) do
    for {{path, type}, _meter} = source <- state.sources,
        is_map_key(dirty, path) or Enum.any?(Path.ancestors(path), &is_map_key(dirty, &1)),
        not crowded?(state, path) or Routes.find(state.routes, path, type) != nil,
        do: source
  end

  # As many as can be done before somebody who wants to subscribe has waited for long.
  defp split([source | rest], state, left) when left > 0 do
    {{path, _type}, _meter} = source
    {now, then} = split(rest, state, left - 10 - crowd(state, path))
    {[source | now], then}
  end

  defp split(then, _state, _left), do: {[], then}

  defp put_route(%{bus: bus} = state, {{path, type}, meter}, routes) do
    if crowded?(state, path) do
      Routes.delete(routes, {path, type})
    else
      {steps, _filtered} = Routes.plan(Pages.above(bus, path), type)
      sequence = if Bus.retained?(bus, path), do: Retention.sequence(bus, path)
      targets = Delivery.targets(bus, steps, path)
      Routes.put(routes, {path, type, meter, targets, Traffic.version(meter), sequence})
    end
  end

  defp crowded?(state, path), do: crowd(state, path) > @most_routed

  defp crowd(%{crowds: crowds}, path) do
    Enum.reduce(Path.ancestors(path), Map.get(crowds, path, 0), &(Map.get(crowds, &1, 0) + &2))
  end

  defp rest(state, start_ms) do
    now_ms = System.monotonic_time(:millisecond)
    cost_ms = now_ms - start_ms + div(:erlang.system_info(:process_count), @processes_a_ms)
    state = %{state | rested_ms: now_ms + 10 * cost_ms}
    if state.dirty == %{}, do: state, else: wake(state)
  end
end
