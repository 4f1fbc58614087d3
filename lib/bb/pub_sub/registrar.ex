defmodule BB.PubSub.Registrar do
  @moduledoc """
  Writes down who is subscribed, and keeps the routes that publishers read. No message goes through it.

  It is the one writer of subscriptions and routes. It answers a subscriber when the new routes are known to publishers, so
  what is published from then on arrives. Making routes known is the expensive part (the more so the more sources there are),
  so it is done once for all who are waiting; new sources, for which publishers find their way without a route, wait for a
  few milliseconds to come together.

  It watches subscribers and removes those that die; it is not linked to them, so that nobody's end is another's. When it
  dies itself, nothing is lost: the tables belong to the process that started the bus, publishers go on with the routes that
  they have, whoever subscribes waits a moment, and its successor goes on from the tables.
  """

  use GenServer

  alias BB.Path
  alias BB.PubSub.{Bus, Delivery, Retention, Routes, Subscription, Traffic}

  @together_ms 5
  @most_waiting 100
  @unnamed_most 1_000

  @enforce_keys [:bus]
  defstruct [
    :bus,
    :timer,
    routes: %{},
    subscriptions: %{},
    subscribers: %{},
    unnamed: :queue.new(),
    dirty: [],
    waiting: []
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

  @doc "Removes a process's subscriptions at a path."
  @spec unsubscribe(Bus.t(), pid(), Path.t()) :: :ok
  def unsubscribe(bus, pid, path), do: call(bus, {:unsubscribe, pid, path})

  @doc "Keeps the last messages at and below a prefix from now on."
  @spec retain(Bus.t(), Path.t()) :: :ok
  def retain(bus, prefix), do: call(bus, {:retain, prefix})

  @attempts 1_000

  # While it is being started again its work is only late. A request may be repeated: it is known by its subscription's id.
  defp call(bus, request, left \\ @attempts) do
    GenServer.call(bus.registrar, request)
  catch
    :exit, {reason, _} when left > 0 and reason in [:noproc, :killed, :shutdown, :normal] ->
      _ = Bus.fetch!(bus.robot)
      Process.sleep(1)
      call(bus, request, left - 1)
  end

  @impl GenServer
  def init(bus) do
    Process.flag(:trap_exit, true)
    subscriptions = Map.new(:ets.tab2list(bus.subscriptions))
    {unnamed, named} = Enum.split_with(sources(bus), fn {{path, _}, _} -> unnamed?(path) end)

    routes =
      for {{path, type}, _meter} <- named, reduce: Routes.new() do
        routes -> Routes.put(routes, {path, type, nil, [], [], nil})
      end

    state = %__MODULE__{
      bus: bus,
      routes: routes,
      subscriptions: subscriptions,
      unnamed: unnamed |> Enum.map(&elem(&1, 0)) |> :queue.from_list(),
      dirty: [[]]
    }

    pids = for {_, list} <- subscriptions, %{pid: pid} <- list, do: pid
    {:ok, pids |> Enum.reduce(state, &watch(&2, &1)) |> flush()}
  end

  @impl GenServer
  def handle_call({:subscribe, subscription}, from, state) do
    if known?(state, subscription),
      do: answer_now(state, from, {:ok, self()}),
      else: state |> add(subscription) |> answer(from, {:ok, self()}, subscription.path)
  end

  def handle_call({:unsubscribe, pid, path}, from, state),
    do: state |> remove(pid, path) |> unwatch(pid) |> answer(from, :ok, path)

  def handle_call({:retain, prefix}, from, state) do
    if prefix in state.bus.retained do
      answer_now(state, from, :ok)
    else
      bus = %{state.bus | retained: [prefix | state.bus.retained]}
      %{state | bus: bus} |> dirty(prefix) |> answer_later(from, :ok)
    end
  end

  @impl GenServer
  def handle_cast({:seen, path, type}, state) do
    cond do
      unnamed?(path) ->
        %{state | unnamed: :queue.in({path, type}, state.unnamed)} |> forget() |> next()

      Routes.find(state.routes, path, type) ->
        next(state)

      true ->
        routes = Routes.put(state.routes, {path, type, nil, [], [], nil})
        %{state | routes: routes} |> later(path) |> next()
    end
  end

  @impl GenServer
  def handle_info(:timeout, state), do: {:noreply, flush(state)}
  def handle_info(:flush, state), do: {:noreply, flush(%{state | timer: nil})}

  def handle_info({:DOWN, _ref, :process, pid, _reason}, state) do
    {{_ref, paths}, subscribers} = Map.pop(state.subscribers, pid, {nil, []})
    state = %{state | subscribers: subscribers}
    paths |> Enum.reduce(state, &(&2 |> remove(pid, &1) |> later_if_routed(&1))) |> next()
  end

  def handle_info(_message, state), do: next(state)

  @impl GenServer
  def terminate(reason, state) do
    if over?(reason) or not Bus.owned?(state.bus), do: Bus.close(state.bus)
  end

  defp over?({:shutdown, _}), do: true
  defp over?(reason), do: reason in [:normal, :shutdown]

  # Subscriptions

  defp known?(state, %{id: id, path: path}),
    do: Enum.any?(at(state, path), &(&1.id == id))

  defp add(state, subscription) do
    :ets.insert(state.bus.tallies, {subscription.id, 0, 0})

    state
    |> change(subscription.pid, [subscription], fn state ->
      put(state, subscription.path, at(state, subscription.path) ++ [subscription])
    end)
    |> watch(subscription.pid)
    |> note(subscription)
  end

  defp remove(state, pid, path) do
    case Enum.split_with(at(state, path), &(&1.pid == pid)) do
      {[], _} ->
        state

      {gone, left} ->
        state = change(state, pid, [], &put(&1, path, left))
        Enum.each(gone, &erase(state.bus, &1))
        state
    end
  end

  defp erase(bus, %{id: id}) do
    :ets.delete(bus.tallies, id)
    :ets.match_delete(bus.cells, {{id, :_}, :_})
  end

  defp put(state, path, []) do
    :ets.delete(state.bus.subscriptions, path)
    %{state | subscriptions: Map.delete(state.subscriptions, path)}
  end

  defp put(state, path, list) do
    :ets.insert(state.bus.subscriptions, {path, list})
    %{state | subscriptions: Map.put(state.subscriptions, path, list)}
  end

  defp at(state, path), do: Map.get(state.subscriptions, path, [])

  defp above(state, path),
    do: at(state, path) ++ Enum.flat_map(Path.ancestors(path), &at(state, &1))

  # Changes the subscriptions of a process so that no tally changes by it: what was counted before counts for those who were
  # there. Only a process with a unique subscription has others whose share changes.
  defp change(state, pid, new, fun) do
    changed = fun.(state)
    present = of(state, pid)

    affected = if Enum.any?(present ++ new, & &1.unique), do: Enum.uniq(present ++ new), else: new

    before = shares(state, affected -- new)
    now = shares(changed, affected)

    for %{id: id} <- affected do
      {delivered, filtered} = Map.get(before, id, {0, 0})
      {delivered_now, filtered_now} = Map.get(now, id, {0, 0})
      Traffic.correct(state.bus, id, {delivered - delivered_now, filtered - filtered_now})
    end

    changed
  end

  defp shares(_state, []), do: %{}
  defp shares(state, list), do: Traffic.shares(sources(state.bus), &above(state, &1), list)

  defp of(state, pid) do
    {_ref, paths} = Map.get(state.subscribers, pid, {nil, []})
    for path <- Enum.uniq(paths), %{pid: ^pid} = subscription <- at(state, path), do: subscription
  end

  # Subscribers

  defp watch(state, pid) do
    if Map.has_key?(state.subscribers, pid) do
      state
    else
      paths = for {path, list} <- state.subscriptions, Enum.any?(list, &(&1.pid == pid)), do: path
      %{state | subscribers: Map.put(state.subscribers, pid, {Process.monitor(pid), paths})}
    end
  end

  defp note(state, %{pid: pid, path: path}) do
    {ref, paths} = Map.fetch!(state.subscribers, pid)
    paths = if path in paths, do: paths, else: [path | paths]
    %{state | subscribers: Map.put(state.subscribers, pid, {ref, paths})}
  end

  defp unwatch(state, pid) do
    case state.subscribers do
      %{^pid => {ref, paths}} ->
        case Enum.filter(paths, fn path -> Enum.any?(at(state, path), &(&1.pid == pid)) end) do
          [] ->
            Process.demonitor(ref, [:flush])
            %{state | subscribers: Map.delete(state.subscribers, pid)}

          left ->
            %{state | subscribers: Map.put(state.subscribers, pid, {ref, left})}
        end

      _ ->
        state
    end
  end

  # Sources

  defp sources(bus), do: :ets.tab2list(bus.traffic)

  defp unnamed?(path), do: Enum.any?(path, &is_reference/1)

  # Paths with references come and go: of those only the newest are remembered.
  defp forget(state) do
    if :queue.len(state.unnamed) > @unnamed_most do
      {{:value, source}, unnamed} = :queue.out(state.unnamed)
      forget(%{state | unnamed: unnamed}, :ets.take(state.bus.traffic, source))
    else
      state
    end
  end

  defp forget(state, sources) do
    reached =
      for {{path, _type}, _meter} <- sources, subscription <- above(state, path), do: subscription

    for {id, share} <- Traffic.shares(sources, &above(state, &1), reached),
        do: Traffic.correct(state.bus, id, share)

    state
  end

  # Routes

  defp dirty(state, path), do: %{state | dirty: [path | state.dirty]}

  # Publishers without a route look at the subscriptions themselves.
  defp answer(state, from, reply, path) do
    if Routes.routed?(state.routes, path) do
      state |> dirty(path) |> answer_later(from, reply)
    else
      answer_now(state, from, reply)
    end
  end

  defp answer_now(state, from, reply) do
    GenServer.reply(from, reply)
    next(state)
  end

  defp answer_later(state, from, reply) do
    state = %{state | waiting: [{from, reply} | state.waiting]}
    if length(state.waiting) < @most_waiting, do: next(state), else: {:noreply, flush(state)}
  end

  # A time-out of 0 comes when nobody else is asking.
  defp next(%{waiting: []} = state), do: {:noreply, state}
  defp next(state), do: {:noreply, state, 0}

  defp later_if_routed(state, path),
    do: if(Routes.routed?(state.routes, path), do: later(state, path), else: state)

  defp later(state, path), do: state |> dirty(path) |> later()

  defp later(%{timer: nil} = state),
    do: %{state | timer: Process.send_after(self(), :flush, @together_ms)}

  defp later(state), do: state

  defp flush(state) do
    routes = state |> stale() |> Enum.reduce(state.routes, &put_route(state, &1, &2))
    Bus.publish(state.bus, routes)
    for {from, reply} <- Enum.reverse(state.waiting), do: GenServer.reply(from, reply)
    %{state | routes: routes, dirty: [], waiting: []}
  end

  defp stale(state) do
    state.dirty |> Enum.uniq() |> Enum.flat_map(&Routes.below(state.routes, &1)) |> Enum.uniq()
  end

  defp put_route(%{bus: bus} = state, {path, type}, routes) do
    {steps, _filtered} = Routes.plan(above(state, path), path, type)
    sequence = if Bus.retained?(bus, path), do: Retention.sequence(bus, path)
    targets = Delivery.targets(bus, steps, path)
    meter = Traffic.meter(bus, path, type)
    Routes.put(routes, {path, type, meter, targets, Routes.metered(steps), sequence})
  end
end
