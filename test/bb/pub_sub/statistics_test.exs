defmodule BB.PubSub.StatisticsTest do
  use ExUnit.Case, async: true

  import BB.Test.Numbered

  alias BB.Message.Sensor.Status
  alias BB.PubSub
  alias BB.Test.Actor

  setup :start_pub_sub

  describe "stats" do
    test "are per subscriber delivered, dropped, filtered", %{robot: robot, actor: actor} do
      publish(robot, [:a], 1..5)
      subscribe(actor, robot, [:a], message_types: [Status])
      publish(robot, [:a, :b], 1..3)
      await_route(robot, [:a, :b], Status)
      publish(robot, [:a, :b], 1..3)
      PubSub.publish(robot, [:a], power())
      PubSub.publish(robot, [:a], status(1), except: [actor])
      publish(robot, [:c], [1])

      assert PubSub.stats(robot) == [
               %{
                 pid: actor,
                 path: [:a],
                 message_types: [Status],
                 delivered: 6,
                 dropped: 0,
                 filtered: 1
               }
             ]
    end

    test "keep what was delivered before when a unique subscription comes and goes", %{
      robot: robot,
      actor: actor
    } do
      subscribe(actor, robot, [])
      publish(robot, [:a], 1..3)
      subscribe(actor, robot, [:a], unique: true)
      publish(robot, [:a], 1..4)
      Actor.run(actor, fn -> PubSub.unsubscribe(robot, [:a]) end)
      publish(robot, [:a], 1..2)
      got = length(numbers(actor))
      assert got == 9
      assert [%{path: [], delivered: delivered, filtered: filtered}] = PubSub.stats(robot)
      assert delivered + filtered == 9
    end
  end
end
