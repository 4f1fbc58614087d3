defmodule BB.PubSub.QueueLimitTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Numbered

  alias BB.Message.Sensor.Status
  alias BB.PubSub
  alias BB.Test.Actor

  setup :start_pub_sub

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
      await_route(robot, path, Status)
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
