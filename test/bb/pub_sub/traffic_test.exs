defmodule BB.PubSub.TrafficTest do
  use ExUnit.Case, async: true
  import BB.Test.Eventually

  alias BB.{Message, PubSub}
  alias BB.Message.Sensor.{PowerState, Status}
  alias BB.Test.Actor

  doctest BB.PubSub.Traffic

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

  # Both ways of a publisher: the one that finds no route yet, and the one that has it.
  defp routed(robot, path, type) do
    eventually(fn ->
      {_, routes, _} = :persistent_term.get(robot)
      PubSub.Routes.find(routes, path, type)
    end)
  end

  describe "topics" do
    test "are every source path seen with payload type, count, rate and age", %{robot: robot} do
      start = System.monotonic_time(:nanosecond)

      for n <- 1..40 do
        times = [monotonic_time: start + n * 10_000_000]

        PubSub.publish(
          robot,
          [:a, :b],
          Message.new!(Status, :f, [state: :up, restarts: n], times)
        )
      end

      PubSub.publish(robot, [:a], power())

      assert [
               %{path: [:a], type: PowerState, count: 1, rate_hz: none},
               %{path: [:a, :b], type: Status, count: 40, rate_hz: rate, age_ns: age}
             ] = PubSub.topics(robot)

      assert none == 0.0
      assert_in_delta rate, 100.0, 0.1
      assert start + 400_000_000 + age <= System.monotonic_time(:nanosecond)
    end

    test "remember only the newest paths with references", %{robot: robot} do
      for _ <- 1..1_100, do: publish(robot, [:reply, make_ref()], [1])
      publish(robot, [:a], [1])
      eventually(fn -> length(PubSub.topics(robot)) == 1_001 end)
      assert Enum.any?(PubSub.topics(robot), &(&1.path == [:a]))
    end
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
