defmodule BB.PubSub.SubscriptionTest do
  use ExUnit.Case, async: true
  import BB.Test.Eventually

  alias BB.{Message, PubSub}
  alias BB.Message.Sensor.{PowerState, Status}
  alias BB.Test.Actor

  setup do
    robot = Module.concat(__MODULE__, "Robot#{System.unique_integer([:positive])}")
    start_supervised!({PubSub, robot})
    %{robot: robot, actor: Actor.start()}
  end

  defp status(n), do: Message.new!(Status, :frame, state: :up, restarts: n)
  defp power, do: Message.new!(PowerState, :frame, voltage: 1.0, current: 0.0)
  defp publish(robot, path, ns), do: Enum.each(ns, &PubSub.publish(robot, path, status(&1)))

  defp subscribe(actor, robot, path, opts \\ []),
    do: {:ok, _} = Actor.run(actor, fn -> PubSub.subscribe(robot, path, opts) end)

  defp numbers(actor) do
    for {path, %Status{restarts: n}} <- Actor.received(actor), do: {path, n}
  end

  # Waits for a route, so that tests cover publishers with and without one.
  defp routed(robot, path, type) do
    eventually(fn ->
      {_, routes, _} = :persistent_term.get(robot)
      PubSub.Routes.find(routes, path, type)
    end)
  end

  describe "wrong options" do
    test "raise ArgumentError saying what was given and what is accepted", %{robot: robot} do
      for {opts, message} <- [
            {[max_rate: 0], ~r/max_rate option.*expected.* got: 0/s},
            {[max_rate: -1.0],
             ~r/max_rate option.*expected a rate in Hz, a number above 0, got: -1.0/s},
            {[max_queue: -1],
             "invalid value for :max_queue option: expected non negative integer, got: -1"},
            {[replay: 1], "invalid value for :replay option: expected boolean, got: 1"},
            {[exact: nil], "invalid value for :exact option: expected boolean, got: nil"},
            {[unique: :yes], "invalid value for :unique option: expected boolean, got: :yes"},
            {[rate: 1],
             ~r/unknown options \[:rate\], valid options are: \[:message_types, :max_rate, /},
            {:all, "invalid options: expected keyword list, got: :all"}
          ] do
        assert_raise ArgumentError, message, fn -> PubSub.subscribe(robot, [:a], opts) end
      end
    end

    test "leave no subscription behind", %{robot: robot} do
      assert_raise ArgumentError, fn -> PubSub.subscribe(robot, [:a], max_rate: 0) end
      assert PubSub.subscribers(robot, [:a]) == []
    end
  end

  describe "max_rate" do
    test "decimates: at most so many per second per path", %{robot: robot, actor: actor} do
      subscribe(actor, robot, [:a], max_rate: 0.001)
      for path <- [[:a], [:a, :b]], do: publish(robot, path, 1..20)
      assert numbers(actor) == [{[:a], 1}, {[:a, :b], 1}]
      assert [%{delivered: 2, dropped: 38}] = PubSub.stats(robot)
    end

    test "lets the next one pass when its time has come", %{robot: robot, actor: actor} do
      subscribe(actor, robot, [:a], max_rate: 200)
      publish(robot, [:a], [1])

      eventually(fn ->
        publish(robot, [:a], [2])
        {[:a], 2} in numbers(actor)
      end)
    end

    test "concerns nobody else", %{robot: robot, actor: actor} do
      subscribe(actor, robot, [:a], max_rate: 0.001)
      PubSub.subscribe(robot, [:a])
      publish(robot, [:a], 1..3)
      for n <- 1..3, do: assert_received({:bb, [:a], %{payload: %{restarts: ^n}}})
    end
  end

  describe "exact" do
    test "is this path only, no descendants", %{robot: robot, actor: actor} do
      subscribe(actor, robot, [:a], exact: true)
      for path <- [[:a], [:a, :b], []], do: publish(robot, path, [1])
      assert numbers(actor) == [{[:a], 1}]
    end
  end

  describe "unique" do
    test "is one copy although several of the caller's subscriptions match", %{
      robot: robot,
      actor: actor
    } do
      for {path, opts} <- [{[], []}, {[:a], [unique: true]}, {[:a], []}, {[:a, :b], []}],
          do: subscribe(actor, robot, path, opts)

      publish(robot, [:a, :b], [1, 2])
      assert numbers(actor) == [{[:a, :b], 1}, {[:a, :b], 2}]
      publish(robot, [:c], [3])
      assert numbers(actor) == [{[:c], 3}]
    end

    test "counts no subscription that wants other types", %{robot: robot, actor: actor} do
      subscribe(actor, robot, [:a], message_types: [PowerState])
      subscribe(actor, robot, [:a], message_types: [Status], unique: true)
      PubSub.publish(robot, [:a], power())
      publish(robot, [:a], [1])
      assert [{[:a], %PowerState{}}, {[:a], %Status{}}] = Actor.received(actor)
    end

    test "takes the copy of the one that is open", %{robot: robot, actor: actor} do
      subscribe(actor, robot, [:a], unique: true, max_rate: 0.001)
      subscribe(actor, robot, [], max_rate: 0.001)
      publish(robot, [:a], 1..3)
      assert numbers(actor) == [{[:a], 1}, {[:a], 2}]
    end

    test "ends with its subscription", %{robot: robot, actor: actor} do
      subscribe(actor, robot, [:a], unique: true)
      for _ <- 1..2, do: subscribe(actor, robot, [])
      Actor.run(actor, fn -> PubSub.unsubscribe(robot, [:a]) end)
      publish(robot, [:a], [1])
      assert numbers(actor) == [{[:a], 1}, {[:a], 1}]
    end
  end

  describe "max_queue" do
    test "a subscriber whose mailbox holds more than n is skipped; each skip is counted and it can see it",
         %{robot: robot, actor: actor} do
      subscribe(actor, robot, [:a], max_queue: 3)
      publish(robot, [:a], 1..10)
      assert numbers(actor) == for(n <- 1..4, do: {[:a], n})
      assert Actor.run(actor, fn -> PubSub.missed(robot) end) == 6
      assert [%{delivered: 4, dropped: 6}] = PubSub.stats(robot)

      eventually(fn ->
        publish(robot, [:a], [11])

        match?(
          [{:missed, [:a], missed}, {[:a], %Status{restarts: 11}}] when missed >= 6,
          Actor.received(actor)
        )
      end)
    end

    test "a subscriber that sleeps under a fast publisher has at most about max_queue messages in its mailbox and learns how many it missed",
         %{robot: robot, actor: actor} do
      path = [:slept, :through]
      subscribe(actor, robot, [:slept], max_queue: 100)
      publish(robot, path, [0])
      routed(robot, path, Status)
      publishers = for _ <- 1..2, do: Task.async(fn -> publish(robot, path, 1..5_000) end)
      Task.await_many(publishers, :infinity)

      assert Actor.waiting(actor) in 100..140
      before = Actor.received(actor)
      missed = Actor.run(actor, fn -> PubSub.missed(robot) end)
      assert missed == 10_001 - Enum.count(before, &match?({^path, _}, &1))
      assert missed > 9_000

      # Some of them may have been reported before.
      later =
        eventually(fn ->
          publish(robot, path, [1])
          received = Actor.received(actor)
          Enum.any?(received, &match?({:missed, [:slept], _}, &1)) && received
        end)

      told = for {:missed, [:slept], n} <- before ++ later, do: n
      assert Enum.sum(told) == Actor.run(actor, fn -> PubSub.missed(robot) end)
    end

    test "other messages in the mailbox count too", %{robot: robot, actor: actor} do
      subscribe(actor, robot, [:a], max_queue: 2)
      for _ <- 1..3, do: send(actor, {:bb, [:other], power()})
      publish(robot, [:a], 1..3)
      assert numbers(actor) == []
    end

    test "does not concern subscribers that did not ask for it", %{robot: robot, actor: actor} do
      subscribe(actor, robot, [:a])
      publish(robot, [:a], 1..500)
      assert length(numbers(actor)) == 500
      assert Actor.run(actor, fn -> PubSub.missed(robot) end) == 0
    end

    test "does not wait for a subscriber that computes", %{robot: robot} do
      test = self()

      busy =
        spawn_link(fn ->
          {:ok, _} = PubSub.subscribe(robot, [:a], max_queue: 0)
          send(test, :subscribed)
          spin()
        end)

      assert_receive :subscribed
      publish(robot, [:a], 1..100)
      [%{delivered: delivered, dropped: dropped}] = PubSub.stats(robot)
      assert delivered + dropped == 100 and delivered <= 1
      Process.unlink(busy)
      Process.exit(busy, :kill)
    end

    defp spin, do: spin()
  end
end
