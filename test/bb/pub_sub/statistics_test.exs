defmodule BB.PubSub.StatisticsTest do
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

  describe "stats" do
    test "are per subscriber delivered, dropped, filtered", %{robot: robot, actor: actor} do
      publish(robot, [:a], 1..5)
      subscribe(actor, robot, [:a], message_types: [Status])
      publish(robot, [:a, :b], 1..3)
      routed(robot, [:a, :b], Status)
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
