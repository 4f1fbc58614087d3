defmodule BB.PubSub.StreamsTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Numbered

  alias BB.Message.Sensor.{PowerState, Status}
  alias BB.{Message, PubSub}

  setup do
    robot = new_robot(__MODULE__)
    start_supervised!({PubSub, robot})
    %{robot: robot}
  end

  describe "topics" do
    test "are every path seen with payload type, count, rate and age", %{robot: robot} do
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
end
