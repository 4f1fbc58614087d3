defmodule BB.PubSub.PlanTest do
  use ExUnit.Case, async: true

  import BB.Test.Numbered

  alias BB.Message.Sensor.{PowerState, Status}
  alias BB.PubSub
  alias BB.Test.Actor

  setup :start_pub_sub

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
end
