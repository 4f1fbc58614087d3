defmodule BB.PubSub.RetentionTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop
  import BB.Test.Eventually
  import BB.Test.Numbered

  alias BB.{Message, PubSub}
  alias BB.Message.Sensor.{PowerState, Status}
  alias BB.Test.Actor

  setup :start_pub_sub

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

    test "is kept from the moment on at which retain returns, whatever routes publishers have", %{
      robot: robot
    } do
      for n <- 1..50 do
        path = [:sensor, :"kept_#{n}"]
        publish(robot, path, [1])
        # Half of the paths have a route by now, made without the retained prefix.
        if rem(n, 2) == 0, do: await_route(robot, path)
        :ok = PubSub.retain(robot, path)
        publish(robot, path, [2])
        assert PubSub.last(robot, path).payload.restarts == 2
        {:ok, _} = PubSub.subscribe(robot, path, replay: true)
        assert_received {:bb, ^path, %{payload: %{restarts: 2}}}
      end
    end

    test "of a robot that is not started raises ArgumentError" do
      for call <- [
            fn -> PubSub.last(NotStarted, [:a]) end,
            fn -> PubSub.retain(NotStarted, [:a]) end,
            fn -> PubSub.topics(NotStarted) end,
            fn -> PubSub.stats(NotStarted) end,
            fn -> PubSub.missed(NotStarted) end
          ],
          do: assert_raise(ArgumentError, ~r/robot NotStarted is not started/, call)
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

  # Processes subscribe while others publish on the same paths. Each round has a new robot, so
  # that some subscribe at the first message of a path.
  property "a late subscriber with replay: true sees the last value of each retained path once, and nothing out of order",
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

  # From its first message on, a subscriber got every message once and in order.
  defp assert_gapless([first | _] = numbers, published) do
    assert numbers == Enum.drop_while(published, &(&1 != first))
  end

  # Keeping a large message takes long enough for others to subscribe meanwhile.
  test "a subscriber that comes while a message is being kept misses nothing", %{robot: robot} do
    path = [:param, :large]
    large = Enum.to_list(1..50_000)
    message = &%{status(&1) | payload: %Status{state: :up, reason: large, restarts: &1}}
    PubSub.publish(robot, path, message.(1))
    await_route(robot, path)
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

  # A subscriber is suspended at any point of its replay. Publishers continue. When it is resumed,
  # it gets the last message of each path as of its subscription, or only newer ones, in order and
  # once.
  test "a subscriber that is suspended while it replays holds up no publisher, and gets everything in order",
       %{
         robot: robot
       } do
    paths = for n <- 1..200, do: [:param, :"suspended_#{n}"]
    for path <- paths, do: publish(robot, path, 1..2)
    test = self()

    for round <- 1..40 do
      newest = 2 + 2 * round

      subscriber =
        spawn_link(fn ->
          {:ok, _} = PubSub.subscribe(robot, [:param], replay: true)
          send(test, {:subscribed, self()})
          receive do: (:tell -> send(test, {self(), take([])}))
        end)

      suspend_in_replay(subscriber, round)

      publisher =
        Task.async(fn -> for path <- paths, do: publish(robot, path, [newest - 1, newest]) end)

      Task.await(publisher, 60_000)
      :erlang.resume_process(subscriber)
      assert_receive {:subscribed, ^subscriber}, 60_000
      send(subscriber, :tell)
      assert_receive {^subscriber, received}, 60_000

      for path <- paths do
        numbers = for {^path, n} <- received, do: n
        assert numbers in [[newest - 2, newest - 1, newest], [newest - 1, newest], [newest]]
      end
    end
  end

  # Resumed and suspended again, until its replay has begun.
  defp suspend_in_replay(pid, turns) do
    for _ <- 1..turns, do: :erlang.yield()
    true = :erlang.suspend_process(pid)

    unless Process.info(pid, :message_queue_len) > {:message_queue_len, 0} do
      :erlang.resume_process(pid)
      suspend_in_replay(pid, 1)
    end
  end

  defp take(taken) do
    receive do
      {:bb, path, message} -> take([{path, message.payload.restarts} | taken])
    after
      0 -> Enum.reverse(taken)
    end
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

      # A process that subscribes now waits for the next registrar.
      assert {:ok, new} = PubSub.subscribe(robot, [:b])
      assert new != old
      publish(robot, [:a], [4])
      publish(robot, [:b], [5])
      assert numbers(actor) == [{[:a], 1}, {[:a], 2}, {[:a], 4}]
      assert_received {:bb, [:b], %{payload: %{restarts: 5}}}
      assert PubSub.last(robot, [:a]).payload.restarts == 4
      assert [%{delivered: 3}] = for(%{pid: ^actor} = row <- PubSub.stats(robot), do: row)

      # The next registrar monitors the subscribers in the tables.
      Actor.stop(actor)
      eventually(fn -> length(PubSub.stats(robot)) == 1 end)
    end

    # A process that got an answer is subscribed once; one that got none is not subscribed.
    test "are right however often the bus's process is killed while others come and go" do
      robot = Module.concat(__MODULE__, "Killed#{System.unique_integer([:positive])}")
      options = [strategy: :one_for_one, max_restarts: 100_000]
      start = {Supervisor, :start_link, [[{PubSub, robot}], options]}
      start_supervised!(%{id: robot, start: start, type: :supervisor})
      publish(robot, [:a, :b], [1])
      killer = spawn_link(fn -> kill_again(PubSub.registry_name(robot)) end)

      actors =
        for n <- 1..300 do
          opts = Enum.at([[], [unique: true], [max_queue: 100], [replay: true]], rem(n, 4))
          actor = Actor.start()
          Task.async(fn -> come_and_go(actor, robot, n, opts) end)
        end
        |> Task.await_many(:infinity)

      Process.unlink(killer)
      Process.exit(killer, :kill)
      publish(robot, [:a, :b], [2])

      for {actor, copies, _subscriptions} <- actors do
        assert for({[:a, :b], 2} <- numbers(actor), do: 2) == List.duplicate(2, copies)
      end

      assert length(PubSub.stats(robot)) == actors |> Enum.map(&elem(&1, 2)) |> Enum.sum()
      for {actor, _copies, _subscriptions} <- actors, do: Actor.stop(actor)
      eventually(fn -> PubSub.stats(robot) == [] end, 60_000)
    end

    # The VM may make routes known after the end of the process that was killed while it did so.
    test "are right when the bus's process is killed while it makes routes known", context do
      %{robot: robot} = context
      busy = for _ <- 1..2, do: spawn_link(fn -> compute() end)

      start =
        {Supervisor, :start_link,
         [[{PubSub, sibling(robot)}], [strategy: :one_for_one, max_restarts: 100_000]]}

      start_supervised!(%{id: :sibling, start: start, type: :supervisor})
      robot = sibling(robot)
      publish(robot, [:a, :b], [1])

      killed =
        for n <- 1..300 do
          {:ok, _} = PubSub.subscribe(robot, [:a, :"gone_#{n}"])
          killed? = kill_suspended(PubSub.registry_name(robot), 20_000)
          actor = Actor.start()
          subscribe(actor, robot, [:a, :b], [])
          publish(robot, [:a, :b], [2])
          assert {n, numbers(actor)} == {n, [{[:a, :b], 2}]}
          Actor.stop(actor)
          killed?
        end

      assert Enum.any?(killed)
      for pid <- busy, do: Process.unlink(pid) && Process.exit(pid, :kill)
    end

    defp sibling(robot), do: Module.concat(robot, Sibling)

    defp compute do
      Enum.sum(1..1_000)
      compute()
    end

    defp kill_suspended(_name, 0), do: false

    defp kill_suspended(name, looks) do
      pid = Process.whereis(name)

      if pid && Process.info(pid, :status) == {:status, :suspended},
        do: Process.exit(pid, :kill),
        else: kill_suspended(name, looks - 1)
    end

    defp come_and_go(actor, robot, n, opts) do
      subscribe(actor, robot, [:a, :b], opts)
      subscribe(actor, robot, [:a], [])

      gone = if rem(n, 3) == 0, do: [:a], else: [:elsewhere]
      :ok = Actor.run(actor, fn -> PubSub.unsubscribe(robot, gone) end)
      subscriptions = if gone == [:a], do: 1, else: 2
      {actor, if(opts[:unique], do: 1, else: subscriptions), subscriptions}
    end

    defp kill_again(name) do
      pid = Process.whereis(name)
      if pid, do: Process.exit(pid, :kill)
      Process.sleep(1)
      kill_again(name)
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

    assert_raise ArgumentError, ~r/to be free for the pubsub of that robot, got: :mine/, fn ->
      PubSub.start_link(robot)
    end

    assert :persistent_term.get(robot) == :mine
    :persistent_term.erase(robot)
  end
end
