defmodule BB.PubSub.RateLimitTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Numbered

  alias BB.PubSub

  setup :start_pub_sub

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
end
