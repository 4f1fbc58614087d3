defmodule BB.Component.ActivityTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually

  alias BB.Component.{Activity, Heartbeat}
  alias BB.{Message, PubSub}
  alias BB.Message.Sensor.{PowerState, Status}

  @path [:sensor, :base, :imu]

  setup do
    robot = Module.concat(__MODULE__, "Robot#{System.unique_integer([:positive])}")
    start_supervised!({PubSub, robot})
    %{robot: robot, heartbeat: Heartbeat.new(1_000)}
  end

  defp now, do: System.monotonic_time(:nanosecond)

  defp publish(robot, path, time_ns, type \\ Status) do
    fields = if type == Status, do: [state: :up, restarts: 0], else: [voltage: 1.0, current: 0.0]
    PubSub.publish(robot, path, Message.new!(type, :imu, fields, monotonic_time: time_ns))
  end

  # Waits for a route, which all messages of a stream but the first few take.
  defp routed(robot, path) do
    eventually(fn ->
      {_, routes, _} = :persistent_term.get(robot)
      PubSub.Routes.find(routes, path, Status)
    end)
  end

  defp last_ns(activity, now), do: Activity.update(activity, now).last_ns

  test "messages on other paths do not count", %{robot: robot, heartbeat: heartbeat} do
    start = now()
    activity = Activity.new(robot, @path, heartbeat, start)
    for path <- [[:sensor, :base], @path ++ [:raw], [:sensor]], do: publish(robot, path, now())
    assert last_ns(activity, now()) == start
  end

  test "messages from before do not count", %{robot: robot, heartbeat: heartbeat} do
    publish(robot, @path, now())
    start = now()
    assert robot |> Activity.new(@path, heartbeat, start) |> last_ns(now()) == start
  end

  test "a message counts at its own time", %{robot: robot, heartbeat: heartbeat} do
    activity = Activity.new(robot, @path, heartbeat, now())
    time = now()
    publish(robot, @path, time)
    assert last_ns(activity, now()) == time
    routed(robot, @path)
    later = now()
    publish(robot, @path, later)
    assert last_ns(Activity.update(activity, later), now()) == later
  end

  test "a message with an impossible time counts now", %{robot: robot, heartbeat: heartbeat} do
    for impossible <- [-1_000_000_000_000, 1_000_000_000_000] do
      activity = Activity.new(robot, @path, heartbeat, now())
      publish(robot, @path, now() + impossible)
      look = now()
      assert last_ns(activity, look) == look
    end
  end

  test "each type of message counts, also a later one", %{robot: robot, heartbeat: heartbeat} do
    publish(robot, @path, now())
    activity = Activity.new(robot, @path, heartbeat, now())
    time = now()
    publish(robot, @path, time, PowerState)
    assert last_ns(activity, now()) == time
  end

  test "without a new message the time does not change", %{robot: robot, heartbeat: heartbeat} do
    activity = Activity.new(robot, @path, heartbeat, now())
    time = now()
    publish(robot, @path, time)
    activity = Activity.update(activity, now())
    for _ <- 1..3, do: assert(last_ns(activity, now()) == time)
  end

  test "a heartbeat counts as a message does", %{robot: robot, heartbeat: heartbeat} do
    activity = Activity.new(robot, @path, heartbeat, now())
    Heartbeat.adopt(heartbeat)
    time = now()
    :ok = Heartbeat.beat(time)
    assert last_ns(activity, now()) == time
  end

  test "without a bus the time does not change", %{robot: robot, heartbeat: heartbeat} do
    start = now()
    activity = Activity.new(robot, @path, heartbeat, start)
    stop_supervised!({PubSub, robot})
    assert last_ns(activity, now()) == start
    assert Activity.new(robot, @path, heartbeat, start).last_ns == start
  end
end
