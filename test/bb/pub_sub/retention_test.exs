defmodule BB.PubSub.RetentionTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop
  import BB.Test.Eventually

  alias BB.{Message, PubSub}
  alias BB.Message.Sensor.{PowerState, Status}
  alias BB.PubSub.Gate
  alias BB.Test.Actor

  setup do
    robot = Module.concat(__MODULE__, "Robot#{System.unique_integer([:positive])}")
    start_supervised!({PubSub, robot})
    %{robot: robot, actor: Actor.start()}
  end

  defp status(n), do: Message.new!(Status, :frame, state: :up, restarts: n)
  defp publish(robot, path, ns), do: Enum.each(ns, &PubSub.publish(robot, path, status(&1)))

  defp subscribe(actor, robot, path, opts),
    do: {:ok, _} = Actor.run(actor, fn -> PubSub.subscribe(robot, path, opts) end)

  defp numbers(actor) do
    for {path, %Status{restarts: n}} <- Actor.received(actor), do: {path, n}
  end

  describe "last" do
    test "is kept of [:param], [:state_machine], [:sensor_status] and everything below them", %{
      robot: robot
    } do
      for head <- [:param, :state_machine, :sensor_status], path <- [[head], [head, :a, :b]] do
        assert PubSub.last(robot, path) == nil
        publish(robot, path, [1, 2])
        assert %Message{robot: ^robot, payload: %{restarts: 2}} = PubSub.last(robot, path)
      end
    end

    test "is nil of other paths", %{robot: robot} do
      publish(robot, [:sensor, :a], [1])
      assert PubSub.last(robot, [:sensor, :a]) == nil
      assert PubSub.last(robot, [:param]) == nil
    end

    test "is kept of any prefix given to retain, from then on", %{robot: robot} do
      publish(robot, [:sensor, :a], [1])
      assert PubSub.retain(robot, [:sensor]) == :ok
      assert PubSub.retain(robot, [:sensor]) == :ok
      assert PubSub.last(robot, [:sensor, :a]) == nil
      publish(robot, [:sensor, :a], [2])
      assert PubSub.last(robot, [:sensor, :a]).payload.restarts == 2
      assert PubSub.last(robot, [:sensor]) == nil
    end

    test "of a robot that is not started raises ArgumentError" do
      for call <- [
            fn -> PubSub.last(NotStarted, [:a]) end,
            fn -> PubSub.retain(NotStarted, [:a]) end,
            fn -> PubSub.topics(NotStarted) end,
            fn -> PubSub.stats(NotStarted) end,
            fn -> PubSub.missed(NotStarted) end
          ],
          do: assert_raise(ArgumentError, ~r/the robot NotStarted is not started/, call)
    end
  end

  defmodule Retaining do
    use BB

    sensors do
      sensor :kept, BB.Test.Counter, retain: true
      sensor :forgotten, BB.Test.Counter
    end
  end

  test "sensors declared retain: true keep their last message" do
    start_supervised!(Retaining)
    {:ok, _} = BB.subscribe(Retaining, [:sensor])
    assert_receive {:bb, [:sensor, :kept], _}
    assert_receive {:bb, [:sensor, :forgotten], _}
    assert %Message{} = PubSub.last(Retaining, [:sensor, :kept])
    assert PubSub.last(Retaining, [:sensor, :forgotten]) == nil
  end

  describe "replay" do
    test "delivers the last message of every matching retained path on subscribing", %{
      robot: robot,
      actor: actor
    } do
      publish(robot, [:param, :a], 1..3)
      publish(robot, [:param, :b], 4..5)
      publish(robot, [:state_machine], [6])
      publish(robot, [:other], [7])
      subscribe(actor, robot, [:param], replay: true)
      assert numbers(actor) == [{[:param, :a], 3}, {[:param, :b], 5}]
    end

    test "is in the mailbox when subscribe returns", %{robot: robot} do
      publish(robot, [:param], [1])
      PubSub.subscribe(robot, [], replay: true)
      assert_received {:bb, [:param], %Message{robot: ^robot, payload: %{restarts: 1}}}
    end

    test "keeps to the types and to the exact path", %{robot: robot, actor: actor} do
      publish(robot, [:param], [1])
      publish(robot, [:param, :a], [2])
      subscribe(actor, robot, [:param], replay: true, exact: true)
      assert numbers(actor) == [{[:param], 1}]
      subscribe(actor, robot, [:param], replay: true, message_types: [PowerState])
      assert numbers(actor) == []
    end

    test "is not what others get", %{robot: robot} do
      PubSub.subscribe(robot, [:param])
      publish(robot, [:param], [1])
      assert_received {:bb, [:param], _}
      subscribe(Actor.start(), robot, [:param], replay: true)
      PubSub.subscribe(robot, [:param])
      refute_received {:bb, _, _}
    end

    test "is one copy with unique", %{robot: robot, actor: actor} do
      publish(robot, [:param, :a], [1])

      for path <- [[:param], [:param, :a], []],
          do: subscribe(actor, robot, path, replay: true, unique: true)

      assert numbers(actor) == [{[:param, :a], 1}]
      publish(robot, [:param, :a], [2])
      assert numbers(actor) == [{[:param, :a], 2}]
    end
  end

  # Subscribers that come while publishers publish, again and again on the same paths. The prefix is fresh in each round, so
  # that some meet the first message of a path.
  property "a late subscriber with replay: true sees the last value of each retained source once, and nothing out of order",
    numtests: 60 do
    forall {publishers, subscribers, messages, first} <-
             {integer(1, 3), integer(1, 3), integer(1, 60), integer(0, 3)} do
      robot = Module.concat(__MODULE__, "Modelled#{System.unique_integer([:positive])}")
      {:ok, bus} = PubSub.start_link(robot)
      paths = for n <- 1..publishers, do: [:param, :"source_#{n}"]
      for path <- paths, do: publish(robot, path, Enum.take(1..3, first))

      publishing =
        for path <- paths, do: Task.async(fn -> publish(robot, path, 4..(3 + messages)) end)

      subscribing =
        for _ <- 1..subscribers,
            do: Task.async(fn -> late_subscriber(robot, paths, 3 + messages) end)

      Task.await_many(publishing, :infinity)

      published = Enum.take(1..3, first) ++ Enum.to_list(4..(3 + messages))

      for received <- Task.await_many(subscribing, :infinity), path <- paths do
        assert_gapless(for({^path, n} <- received, do: n), published)
      end

      GenServer.stop(bus)
      true
    end
  end

  defp late_subscriber(robot, paths, last) do
    {:ok, _} = PubSub.subscribe(robot, [:param], replay: true)
    collect(paths, last, [])
  end

  defp collect([], _last, received), do: Enum.reverse(received)

  defp collect(waiting, last, received) do
    receive do
      {:bb, path, %{payload: %{restarts: ^last}}} ->
        collect(List.delete(waiting, path), last, [{path, last} | received])

      {:bb, path, %{payload: %{restarts: n}}} ->
        collect(waiting, last, [{path, n} | received])
    after
      5_000 -> raise "no last message of #{inspect(waiting)}; received #{inspect(received)}"
    end
  end

  # From the first one on, whichever that is, everything once and in order.
  defp assert_gapless([first | _] = numbers, published) do
    assert numbers == Enum.drop_while(published, &(&1 != first))
  end

  # Keeping a large message takes a while, in which others subscribe.
  test "a subscriber that comes while a message is being kept misses nothing", %{robot: robot} do
    path = [:param, :large]
    large = Enum.to_list(1..50_000)
    message = &%{status(&1) | payload: %Status{state: :up, reason: large, restarts: &1}}
    PubSub.publish(robot, path, message.(1))
    routed(robot, path)
    test = self()

    publishing =
      Task.async(fn ->
        for n <- 2..41 do
          message = message.(n)
          if rem(n, 4) == 0, do: send(test, :subscribe)
          PubSub.publish(robot, path, message)
        end
      end)

    subscribing =
      for _ <- 1..10 do
        assert_receive :subscribe
        Task.async(fn -> for {^path, n} <- late_subscriber(robot, [path], 41), do: n end)
      end

    Task.await(publishing, :infinity)
    for task <- subscribing, do: assert_gapless(Task.await(task, :infinity), Enum.to_list(1..41))
  end

  defp routed(robot, path) do
    eventually(fn ->
      {_, routes, _} = :persistent_term.get(robot)
      PubSub.Routes.find(routes, path, Status)
    end)
  end

  test "a message that is being replayed holds up a newer one, an older one is not delivered any more" do
    cell = :atomics.new(2, [])
    subscription = %{PubSub.Subscription.new([:a], replay: true) | pid: self()}
    gate = {Gate.counters(), cell, subscription}
    test = self()

    Gate.replay(cell, fn ->
      newer = Task.async(fn -> Gate.deliver([gate], test, {:bb, :newer}, 6) end)
      older = Task.async(fn -> Gate.deliver([gate], test, {:bb, :older}, 4) end)
      same = Task.async(fn -> Gate.deliver([gate], test, {:bb, :same}, 5) end)
      send(test, {:tasks, [newer, older, same]})
      :erlang.yield()
      send(test, {:bb, :replayed})
      5
    end)

    assert_received {:tasks, tasks}
    Task.await_many(tasks, :infinity)
    assert_received {:bb, first}
    assert_received {:bb, second}
    assert {first, second} == {:replayed, :newer}
    refute_received {:bb, _}
  end

  test "a publisher that was first leaves nothing to replay" do
    cell = :atomics.new(2, [])
    subscription = %{PubSub.Subscription.new([:a], replay: true) | pid: self()}
    Gate.deliver([{Gate.counters(), cell, subscription}], self(), {:bb, :first}, 5)
    Gate.replay(cell, fn -> flunk("replayed") end)
    assert_received {:bb, :first}
  end

  test "a publisher does not wait for a subscriber that died while it replayed" do
    cell = :atomics.new(2, [])
    actor = Actor.start()
    Actor.stop(actor)
    :atomics.put(cell, 1, -1)
    subscription = %{PubSub.Subscription.new([:a], replay: true) | pid: actor}
    assert Gate.deliver([{Gate.counters(), cell, subscription}], actor, :late, 1) == :ok
  end

  describe "subscriptions and last messages" do
    test "survive the death of the bus's process, and so does the robot's publishing", %{
      robot: robot,
      actor: actor
    } do
      subscribe(actor, robot, [:a], max_queue: 100)
      PubSub.retain(robot, [:a])
      publish(robot, [:a], [1])
      name = PubSub.registry_name(robot)
      old = Process.whereis(name)
      ref = Process.monitor(old)
      Process.exit(old, :kill)
      assert_receive {:DOWN, ^ref, _, _, _}
      publish(robot, [:a], [2])
      publish(robot, [:b], [3])

      # Whoever subscribes now waits for the successor.
      assert {:ok, new} = PubSub.subscribe(robot, [:b])
      assert new != old
      publish(robot, [:a], [4])
      publish(robot, [:b], [5])
      assert numbers(actor) == [{[:a], 1}, {[:a], 2}, {[:a], 4}]
      assert_received {:bb, [:b], %{payload: %{restarts: 5}}}
      assert PubSub.last(robot, [:a]).payload.restarts == 4
      assert [%{delivered: 3}] = for(%{pid: ^actor} = row <- PubSub.stats(robot), do: row)

      # The successor watches those whom it found.
      Actor.stop(actor)
      eventually(fn -> length(PubSub.stats(robot)) == 1 end)
    end

    test "end with the robot", %{robot: robot} do
      PubSub.subscribe(robot, [:a])
      stop_supervised!({PubSub, robot})
      assert_raise ArgumentError, fn -> publish(robot, [:a], [1]) end
      assert PubSub.unsubscribe(robot, [:a]) == :ok
      start_supervised!({PubSub, robot})
      publish(robot, [:a], [1])
      refute_received {:bb, _, _}
    end

    test "end with the supervisor that started the bus, however it dies" do
      robot = Module.concat(__MODULE__, "Orphan#{System.unique_integer([:positive])}")
      {:ok, root} = Supervisor.start_link([{PubSub, robot}], strategy: :one_for_one)
      Process.unlink(root)
      bus = Process.monitor(Process.whereis(PubSub.registry_name(robot)))
      Process.exit(root, :kill)
      assert_receive {:DOWN, ^bus, _, _, _}
      assert_raise ArgumentError, fn -> publish(robot, [:a], [1]) end
    end
  end

  test "stopping a robot does not touch its subscribers", %{robot: robot} do
    test = self()

    pid =
      spawn(fn ->
        {:ok, bus} = PubSub.subscribe(robot, [:a])
        {:links, links} = Process.info(self(), :links)
        send(test, {:links, bus in links})
        receive do: (:stop -> :ok)
      end)

    assert_receive {:links, false}
    stop_supervised!({PubSub, robot})
    assert Process.alive?(pid)
    send(pid, :stop)
  end

  test "a term of somebody else's under the robot's name is not taken for a bus" do
    robot = Module.concat(__MODULE__, "Taken#{System.unique_integer([:positive])}")
    :persistent_term.put(robot, :mine)
    assert_raise ArgumentError, ~r/is not started/, fn -> publish(robot, [:a], [1]) end
    assert_raise ArgumentError, ~r/belongs to the bus/, fn -> PubSub.start_link(robot) end
    assert :persistent_term.get(robot) == :mine
    :persistent_term.erase(robot)
  end
end
