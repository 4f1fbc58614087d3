defmodule BB.PubSub.ModelTest do
  @moduledoc """
  Compares the bus with a naive model: lists that are searched from end to end at each
  publication.

  Subscribers leave all messages in their mailboxes, so that `max_queue` and `max_rate` are exact.
  """

  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.{Message, PubSub}
  alias BB.Message.Sensor.{PowerState, Status}
  alias BB.Test.Actor

  @actors 0..2
  # Atoms with a meaning in match specifications are segments like others. `:reference` stands for
  # a reference that is new in each run.
  @paths [[], [:a], [:b], [:a, :a], [:a, :b], [:a, :b, :c], [:param], [:param, :a]] ++
           [[:a, :_], [:"$1"], [:a, :reference], [:param, :reference]]
  @types [[], [Status], [PowerState], [Status, PowerState]]

  defp step do
    who = integer(0, 2)
    path = oneof(@paths)

    frequency([
      {4, {:subscribe, who, path, options()}},
      {2, {:unsubscribe, who, path}},
      {8, {:publish, path, oneof([Status, PowerState]), list(who)}},
      {1, {:retain, path}},
      {1, {:exit, who}}
    ])
  end

  # A rate of one message in ten thousand seconds, so one message in a run.
  defp options do
    option =
      oneof([
        {:message_types, oneof(@types)},
        {:exact, boolean()},
        {:unique, boolean()},
        {:replay, true},
        {:max_rate, 0.0001},
        {:max_queue, integer(0, 7)}
      ])

    map(list(option), &Enum.uniq_by(&1, fn {key, _} -> key end))
  end

  property "deliveries, their order, stats and last messages are those of the model",
    numtests: 150 do
    forall steps <- list(step()) do
      robot = Module.concat(__MODULE__, "Robot#{System.unique_integer([:positive])}")
      {:ok, bus} = PubSub.start_link(robot)
      Process.put(:reference, make_ref())
      actors = Map.new(@actors, &{&1, Actor.start()})
      numbered = Enum.with_index(steps, 1)

      actors = Enum.reduce(numbered, actors, &act(&1, robot, &2))
      model = Enum.reduce(numbered, new(), &expect/2)

      compare(robot, actors, model)
      for {_, actor} <- actors, do: Actor.stop(actor)
      GenServer.stop(bus)
      true
    end
  end

  defp compare(robot, actors, model) do
    rows = PubSub.stats(robot)

    for {who, actor} <- actors do
      assert {who, numbers(Actor.received(actor))} ==
               {who, Enum.reverse(Map.get(model.mailboxes, who, []))}

      mine = for s <- model.subscriptions, s.who == who, do: {real(s.path), model.counts[s.id]}
      counted = for %{pid: ^actor} = r <- rows, do: {r.path, {r.delivered, r.dropped, r.filtered}}
      assert Enum.sort(counted) == Enum.sort(mine)
    end

    for path <- @paths do
      expected = for %{path: ^path} = s <- model.subscriptions, do: {actors[s.who], types(s)}
      assert Enum.sort(PubSub.subscribers(robot, real(path))) == Enum.sort(expected)
      assert number(PubSub.last(robot, real(path))) == model.last[path]
    end
  end

  defp real(path),
    do: Enum.map(path, &if(&1 == :reference, do: Process.get(:reference), else: &1))

  defp model(path), do: Enum.map(path, &if(is_reference(&1), do: :reference, else: &1))

  defp numbers(received), do: for({path, payload} <- received, do: {model(path), number(payload)})
  defp number(nil), do: nil
  defp number(%Message{payload: payload}), do: number(payload)
  defp number(%Status{restarts: n}), do: {Status, n}
  defp number(%PowerState{voltage: v}), do: {PowerState, trunc(v)}

  # The steps, run on the bus.

  defp act({{:subscribe, who, path, opts}, _n}, robot, actors) do
    path = real(path)
    {:ok, _} = Actor.run(actors[who], fn -> PubSub.subscribe(robot, path, opts) end)
    actors
  end

  defp act({{:unsubscribe, who, path}, _n}, robot, actors) do
    path = real(path)
    :ok = Actor.run(actors[who], fn -> PubSub.unsubscribe(robot, path) end)
    actors
  end

  defp act({{:exit, who}, _n}, _robot, actors) do
    Actor.stop(actors[who])
    Map.put(actors, who, Actor.start())
  end

  defp act({{:retain, path}, _n}, robot, actors) do
    :ok = PubSub.retain(robot, real(path))
    actors
  end

  defp act({{:publish, path, type, except}, n}, robot, actors) do
    opts = if except == [], do: [], else: [except: Enum.map(except, &actors[&1])]
    :ok = PubSub.publish(robot, real(path), message(type, n), opts)
    actors
  end

  defp message(Status, n), do: Message.new!(Status, :frame, state: :up, restarts: n)
  defp message(PowerState, n), do: Message.new!(PowerState, :frame, voltage: n / 1, current: 0.0)

  # The steps, run on the model.

  defp new do
    %{
      subscriptions: [],
      mailboxes: %{},
      last: %{},
      retained: [[:param], [:state_machine], [:sensor_status]],
      spent: MapSet.new(),
      counts: %{}
    }
  end

  defp expect({{:subscribe, who, path, opts}, n}, model) do
    new = %{id: n, who: who, path: path, opts: Map.new(opts)}
    model = put_in(model.counts[n], {0, 0, 0})
    model = %{model | subscriptions: model.subscriptions ++ [new]}
    if new.opts[:replay], do: replay(model, new), else: model
  end

  defp expect({{:unsubscribe, who, path}, _n}, model),
    do: remove(model, &(&1.who == who and &1.path == path))

  defp expect({{:exit, who}, _n}, model) do
    model = remove(model, &(&1.who == who))
    %{model | mailboxes: Map.delete(model.mailboxes, who)}
  end

  defp expect({{:retain, path}, _n}, model), do: %{model | retained: [path | model.retained]}

  defp expect({{:publish, path, type, except}, n}, model) do
    model =
      if Enum.any?(model.retained, &below?(path, &1)),
        do: put_in(model.last[path], {type, n}),
        else: model

    hearing =
      for level <- [path | BB.Path.ancestors(path)],
          %{path: ^level} = s <- model.subscriptions,
          hears?(s, path),
          do: s

    {wanting, others} = Enum.split_with(hearing, &wants?(&1, type))
    model = Enum.reduce(others, model, &count(&2, &1, {0, 0, 1}))
    wanting |> copies([]) |> Enum.reduce(model, &copy(&2, &1, path, {type, n}, except))
  end

  # Each copy goes to the first subscription in its list that takes it.
  defp copies([], _done), do: []

  defp copies([first | rest], done) do
    same = Enum.filter([first | rest], &(&1.who == first.who))

    cond do
      first.who in done -> copies(rest, done)
      Enum.any?(same, & &1.opts[:unique]) -> [same | copies(rest, [first.who | done])]
      true -> [[first] | copies(rest, done)]
    end
  end

  defp copy(model, [first | _] = list, path, message, except) do
    case Enum.find(list, &(not gated?(&1))) do
      nil ->
        if first.who in except, do: model, else: try_each(model, list, path, message)

      plain ->
        shadowed = List.delete(list, plain)
        model = Enum.reduce(shadowed, model, &count(&2, &1, {0, 0, 1}))
        if plain.who in except, do: model, else: deliver(model, plain, path, message)
    end
  end

  defp try_each(model, [], _path, _message), do: model

  defp try_each(model, [first | rest], path, message) do
    if open?(model, first, path) do
      model = deliver(model, first, path, message)
      Enum.reduce(rest, model, &count(&2, &1, {0, 0, 1}))
    else
      model |> count(first, {0, 1, 0}) |> try_each(rest, path, message)
    end
  end

  defp replay(model, new) do
    for {path, {type, _} = message} <- Enum.sort(model.last),
        hears?(new, path),
        wants?(new, type),
        not had?(model, new, path),
        reduce: model do
      model -> try_each(model, [new], path, message)
    end
  end

  defp had?(model, new, path) do
    Enum.any?(model.subscriptions, fn other ->
      other.id != new.id and other.who == new.who and other.opts[:replay] == true and
        hears?(other, path) and (new.opts[:unique] == true or other.opts[:unique] == true)
    end)
  end

  defp deliver(model, to, path, message) do
    mailboxes = Map.update(model.mailboxes, to.who, [{path, message}], &[{path, message} | &1])

    count(
      %{model | mailboxes: mailboxes, spent: MapSet.put(model.spent, {to.id, path})},
      to,
      {1, 0, 0}
    )
  end

  defp open?(model, %{opts: opts} = s, path) do
    waiting = length(Map.get(model.mailboxes, s.who, []))
    due? = opts[:max_rate] == nil or {s.id, path} not in model.spent
    due? and (opts[:max_queue] == nil or waiting <= opts[:max_queue])
  end

  defp gated?(%{opts: opts}),
    do: opts[:replay] == true or opts[:max_rate] != nil or opts[:max_queue] != nil

  defp count(model, %{id: id}, {d, x, f}) do
    update_in(model.counts[id], fn {delivered, dropped, filtered} ->
      {delivered + d, dropped + x, filtered + f}
    end)
  end

  defp remove(model, fun),
    do: %{model | subscriptions: Enum.reject(model.subscriptions, fun)}

  defp hears?(%{path: at, opts: %{exact: true}}, path), do: at == path
  defp hears?(%{path: at}, path), do: below?(path, at)
  defp wants?(s, type), do: types(s) == [] or type in types(s)
  defp types(%{opts: opts}), do: Map.get(opts, :message_types, [])
  defp below?(path, prefix), do: Enum.take(path, length(prefix)) == prefix
end
