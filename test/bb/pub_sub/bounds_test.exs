defmodule BB.PubSub.BoundsTest do
  @moduledoc """
  The cost of the bus is linear in its subscribers, and its memory is bounded. The tests count
  reductions and words, and measure no time.
  """

  use ExUnit.Case, async: true
  import BB.Test.Eventually
  import BB.Test.Numbered
  import ExUnit.CaptureLog

  alias BB.{Message, PubSub}
  alias BB.Message.Sensor.Status
  alias BB.Test.Actor

  @patience_ms 60_000
  # As in the documentation of BB.PubSub.
  @permanent 4_000
  @transient 1_000

  setup do
    robot = new_robot(__MODULE__)
    start_supervised!({PubSub, robot})
    %{robot: robot, bus: Process.whereis(PubSub.registry_name(robot))}
  end

  defp tables(robot) do
    {PubSub.Bus, _routes, bus} = :persistent_term.get(robot)

    for {name, table} when is_reference(table) <- Map.from_struct(bus),
        :ets.info(table) != :undefined,
        into: %{},
        do: {name, table}
  end

  defp rows(robot), do: Enum.sum(for {_, table} <- tables(robot), do: :ets.info(table, :size))

  # Memory in words: that of the tables, of the routes, and of the process that writes them.
  defp memory(robot, bus) do
    :erlang.garbage_collect(bus)
    {PubSub.Bus, routes, _bus} = :persistent_term.get(robot)
    {:total_heap_size, heap} = Process.info(bus, :total_heap_size)
    tables = for {_, table} <- tables(robot), do: :ets.info(table, :memory)
    Enum.sum(tables) + :erts_debug.flat_size(routes) + heap
  end

  defp reductions(bus), do: bus |> Process.info(:reductions) |> elem(1)

  # The processes subscribe one after the other, so that the bus cannot combine changes.
  defp crowd(robot, n, path, opts) do
    test = self()

    for _ <- 1..n do
      pid =
        spawn_link(fn ->
          {:ok, _} = PubSub.subscribe(robot, path, opts)
          send(test, {:subscribed, self()})
          receive do: ({:bb, _, message} -> send(test, {self(), message.payload.restarts}))
          receive do: (:stop -> :ok)
        end)

      assert_receive {:subscribed, ^pid}, @patience_ms
      pid
    end
  end

  describe "subscribers on one path" do
    test "cost the same each, in memory and in work, however many there are" do
      for opts <- [[], [max_queue: 10], [replay: true, unique: true], [unique: true]] do
        {few, few_words} = cost(600, opts)
        {many, many_words} = cost(4_800, opts)
        assert many < 2 * few, "#{inspect(opts)}: #{few} then #{many} reductions for each"

        assert many_words < 2 * few_words,
               "#{inspect(opts)}: #{few_words} then #{many_words} words"
      end
    end

    # Reductions for subscribing, one message and the end of each subscriber; and the words it
    # takes.
    defp cost(n, opts) do
      robot = Module.concat(__MODULE__, "Crowd#{System.unique_integer([:positive])}")
      {:ok, bus} = PubSub.start_link(robot)
      for source <- 1..5, do: publish(robot, [:param, :"source_#{source}"], [0])
      eventually(fn -> routed?(robot, [:param, :source_1]) end)
      empty = memory(robot, bus)
      before = reductions(bus)
      pids = crowd(robot, n, [:param], opts)
      words = memory(robot, bus) - empty
      for pid <- pids, do: Process.unlink(pid) && Process.exit(pid, :kill)

      eventually(
        fn -> PubSub.subscribers(robot, [:param]) == [] and rows_of(robot) end,
        @patience_ms
      )

      work = reductions(bus) - before
      GenServer.stop(bus)
      {work / n, words / n}
    end

    defp rows_of(robot), do: :ets.info(tables(robot).places, :size) == 0

    test "may be ten thousand, who subscribe beside a publisher, are all sent what is published, and leave nothing",
         %{robot: robot, bus: bus} do
      path = [:sensor, :crowd]
      publish(robot, path, [0])
      empty = rows(robot)
      publisher = spawn_link(fn -> publish_on(robot, [:sensor, :other], 1) end)
      pids = crowd(robot, 10_000, path, [])
      Process.unlink(publisher)
      Process.exit(publisher, :kill)
      assert memory(robot, bus) * :erlang.system_info(:wordsize) < 50_000_000

      publish(robot, path, [7])
      for pid <- pids, do: assert_receive({^pid, 7}, @patience_ms)
      assert length(PubSub.subscribers(robot, path)) == 10_000
      assert Enum.all?(PubSub.stats(robot), &(&1.delivered == 1))

      for pid <- pids, do: send(pid, :stop)
      eventually(fn -> rows(robot) <= empty + 1 end, @patience_ms)
      publish(robot, path, [8])
      assert PubSub.subscribers(robot, path) == []
    end

    defp publish_on(robot, path, n) do
      publish(robot, path, [n])
      publish_on(robot, path, n + 1)
    end

    test "get what is published from the moment on at which they have subscribed, in a crowd as alone",
         %{robot: robot} do
      publish(robot, [:a], [0])
      eventually(fn -> routed?(robot, [:a]) end)

      # Without waiting for routes, and beyond the number of subscribers that have routes.
      actors =
        for n <- 1..700 do
          actor = Actor.start()
          {:ok, _} = Actor.run(actor, fn -> PubSub.subscribe(robot, [:a]) end)
          if rem(n, 100) == 0, do: publish(robot, [:a], [n])
          {actor, n}
        end

      for {actor, n} <- actors do
        got =
          for {[:a], %Status{restarts: number}} <- Actor.received(actor), number > 0, do: number

        assert got == Enum.filter(100..700//100, &(&1 >= n))
        :ok = Actor.run(actor, fn -> PubSub.unsubscribe(robot, [:a]) end)
        publish(robot, [:a], [0])
        assert Actor.received(actor) == []
        Actor.stop(actor)
      end

      eventually(fn -> routed?(robot, [:a]) end)
    end
  end

  test "a process with thousands of paths costs the same for each", %{robot: robot, bus: bus} do
    paths = for n <- 1..3_000, do: [:mine, :"path_#{n}"]
    half = for path <- Enum.take(paths, 1_500), do: PubSub.subscribe(robot, path)
    before = reductions(bus)
    for path <- Enum.take(paths, 100), do: PubSub.subscribe(robot, path)
    few = reductions(bus) - before
    for path <- Enum.drop(paths, length(half)), do: PubSub.subscribe(robot, path)
    before = reductions(bus)
    for path <- Enum.take(paths, 100), do: PubSub.subscribe(robot, path)
    assert reductions(bus) - before < 2 * few
    for path <- paths, do: :ok = PubSub.unsubscribe(robot, path)
    assert rows(robot) == 0
  end

  describe "paths with references" do
    test "leave nothing behind but the newest thousand, whatever is asked for of them", %{
      robot: robot
    } do
      actor = Actor.start()

      for {path, opts} <- [
            {[], [max_rate: 0.001]},
            {[:reply], [max_queue: 10]},
            {[:reply], [unique: true, max_rate: 10]},
            {[:param], [replay: true]},
            {[:param], [max_rate: 10]}
          ],
          do: {:ok, _} = Actor.run(actor, fn -> PubSub.subscribe(robot, path, opts) end)

      log =
        capture_log(fn ->
          come_and_go(robot, 3 * @transient)
          Process.put(:rows, rows(robot))
          come_and_go(robot, 3 * @transient)
        end)

      assert rows(robot) <= Process.get(:rows) + 10
      assert rows(robot) < 15 * @transient
      assert length(PubSub.topics(robot)) == 2 * @transient

      # The bus logs once that it forgets last messages.
      assert [_before, _after] =
               String.split(log, "keeps the last messages of the newest 1000 transient paths")
    end

    defp come_and_go(robot, n) do
      for _ <- 1..n, head <- [:reply, :param], do: publish(robot, [head, make_ref()], [1])
    end

    test "are counted for each subscription as all others", %{robot: robot} do
      {:ok, _} = PubSub.subscribe(robot, [:reply])
      {:ok, _} = PubSub.subscribe(robot, [:reply], message_types: [Message.Sensor.Range])
      {:ok, _} = PubSub.subscribe(robot, [:reply], max_rate: 0.001)
      n = 3 * @transient
      for _ <- 1..n, do: publish(robot, [:reply, make_ref()], [1])

      assert [{^n, 0, 0}, {0, 0, ^n}, {^n, 0, 0}] =
               for(row <- PubSub.stats(robot), do: {row.delivered, row.dropped, row.filtered})

      publish(robot, [:reply, make_ref()], [1, 2])

      assert [_, _, {_, 1, 0}] =
               for(row <- PubSub.stats(robot), do: {row.delivered, row.dropped, row.filtered})
    end

    test "keep the last messages of the newest", %{robot: robot} do
      paths = for n <- 1..(2 * @transient), do: {[:param, make_ref()], n}
      capture_log(fn -> for {path, n} <- paths, do: publish(robot, path, [n]) end)
      # Transient paths that are not retained replace none of them.
      for _ <- 1..(2 * @transient), do: publish(robot, [:reply, make_ref()], [1])

      for {path, n} <- paths do
        last = PubSub.last(robot, path)
        assert if(n > @transient, do: last.payload.restarts == n, else: last == nil)
      end

      {:ok, _} = PubSub.subscribe(robot, [:param], replay: true)

      for {path, n} <- paths,
          n > @transient,
          do: assert_received({:bb, ^path, %{payload: %{restarts: ^n}}})

      refute_received {:bb, _, _}
    end

    test "are forgotten by many publishers at once without a row too many", %{robot: robot} do
      {:ok, _} = Actor.run(Actor.start(), fn -> PubSub.subscribe(robot, [], max_rate: 1) end)
      few = for _ <- 1..1_200, do: [:few, make_ref()]

      publishers =
        for _ <- 1..4,
            do: Task.async(fn -> for path <- Enum.shuffle(few), do: publish(robot, path, [1]) end)

      Task.await_many(publishers, @patience_ms)
      {PubSub.Bus, _routes, bus} = :persistent_term.get(robot)
      remembered = for {{[_ | _] = path, 0}, _place} <- :ets.tab2list(bus.transient), do: path
      assert length(remembered) == @transient
      for {{_id, path}, _cell} <- :ets.tab2list(bus.cells), do: assert(path in remembered)

      for {{path, type}, _} when is_list(path) and type != 0 <- :ets.tab2list(bus.transient),
          do: assert(path in remembered)
    end
  end

  describe "ever new paths of atoms" do
    test "are remembered up to a number, delivered all, and slow nobody down who subscribes", %{
      robot: robot,
      bus: bus
    } do
      {:ok, _} = PubSub.subscribe(robot, [:ever])
      {:ok, _} = PubSub.subscribe(robot, [:ever], max_rate: 1)
      most = @permanent + 2 * @transient
      test = self()

      publishers =
        for half <- 0..1 do
          spawn_link(fn ->
            for n <- 1..most, rem(n, 2) == half, do: publish(robot, [:ever, :"new_#{n}"], [n])
            send(test, {:published, self()})
          end)
        end

      # While they publish or after: a subscriber gets its answer, and the publishers' messages
      # are not in the mailbox of the bus.
      for n <- 1..200 do
        assert {:ok, ^bus} = PubSub.subscribe(robot, [:elsewhere, :"path_#{n}"])
        {:message_queue_len, waiting} = Process.info(bus, :message_queue_len)
        assert waiting <= @permanent
      end

      for pid <- publishers, do: assert_receive({:published, ^pid}, @patience_ms)

      for n <- 1..most do
        path = [:ever, :"new_#{n}"]
        for _ <- 1..2, do: assert_received({:bb, ^path, %{payload: %{restarts: ^n}}})
      end

      for row <- PubSub.stats(robot), row.path == [:ever], do: assert(row.delivered == most)
      assert length(PubSub.topics(robot)) <= @permanent + 2 + 2 * @transient
      assert rows(robot) < 10 * (@permanent + @transient)
    end

    test "below a retained path keep their last messages up to a number", %{robot: robot} do
      most = @permanent + 3 * @transient

      capture_log(fn -> for n <- 1..most, do: publish(robot, [:param, :"kept_#{n}"], [n]) end)

      assert PubSub.last(robot, [:param, :kept_1]).payload.restarts == 1
      assert PubSub.last(robot, [:param, :"kept_#{most}"]).payload.restarts == most
      assert :ets.info(tables(robot).last, :size) == @permanent + @transient
    end
  end

  test "the prefixes that are retained are bounded, and those below another cost nothing", %{
    robot: robot
  } do
    for n <- 1..2_000, do: :ok = PubSub.retain(robot, [:param, :"prefix_#{n}"])

    assert_raise ArgumentError, ~r/at most 1000 retained prefixes, got one more: \[#Ref/, fn ->
      for _ <- 1..1_000, do: PubSub.retain(robot, [make_ref()])
    end
  end

  describe "a path that is too long" do
    test "is refused at once, whatever takes a path, and leaves nothing behind", %{robot: robot} do
      for n <- [65, 10_000, 1_000_000] do
        path = List.duplicate(:a, n)

        for call <- [
              fn -> PubSub.publish(robot, path, status(1)) end,
              fn -> PubSub.publish(robot, path, status(1), except: [self()]) end,
              fn -> PubSub.subscribe(robot, path) end,
              fn -> PubSub.unsubscribe(robot, path) end,
              fn -> PubSub.subscribers(robot, path) end,
              fn -> PubSub.retain(robot, path) end,
              fn -> PubSub.last(robot, path) end,
              fn -> BB.Safety.inhibit(robot, path, :test) end
            ] do
          assert_raise ArgumentError,
                       ~r/expected a path of at most 64 segments, got: #{n} in/,
                       call
        end
      end

      assert rows(robot) == 0
    end

    test "is one of 65 segments, not one of 64", %{robot: robot} do
      path = for n <- 1..64, do: :"segment_#{n}"
      {:ok, _} = PubSub.subscribe(robot, path)
      {:ok, _} = PubSub.subscribe(robot, [])
      for n <- 1..2, do: publish(robot, path, [n])
      for n <- [1, 1, 2, 2], do: assert_received({:bb, ^path, %{payload: %{restarts: ^n}}})
      refute_received {:bb, _, _}
    end
  end

  defp routed?(robot, path) do
    {PubSub.Bus, routes, _bus} = :persistent_term.get(robot)
    PubSub.Routes.find(routes, path, Status) != nil
  end
end
