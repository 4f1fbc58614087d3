defmodule BB.Component.HearingTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually

  alias BB.Component.{Hearing, Pulse}
  alias BB.{Message, PubSub}
  alias BB.Message.Sensor.{PowerState, Status}

  @path [:sensor, :base, :imu]

  setup do
    robot = Module.concat(__MODULE__, "Robot#{System.unique_integer([:positive])}")
    start_supervised!({PubSub, robot})
    %{robot: robot, pulse: Pulse.new(1_000)}
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

  defp heard(hearing, now), do: Hearing.look(hearing, now).heard_ns

  test "nothing is heard of what is published elsewhere", %{robot: robot, pulse: pulse} do
    start = now()
    hearing = Hearing.new(robot, @path, pulse, start)
    for path <- [[:sensor, :base], @path ++ [:raw], [:sensor]], do: publish(robot, path, now())
    assert heard(hearing, now()) == start
  end

  test "what was published before does not count", %{robot: robot, pulse: pulse} do
    publish(robot, @path, now())
    start = now()
    assert robot |> Hearing.new(@path, pulse, start) |> heard(now()) == start
  end

  test "a message is heard at its own time", %{robot: robot, pulse: pulse} do
    hearing = Hearing.new(robot, @path, pulse, now())
    time = now()
    publish(robot, @path, time)
    assert heard(hearing, now()) == time
    routed(robot, @path)
    later = now()
    publish(robot, @path, later)
    assert heard(Hearing.look(hearing, later), now()) == later
  end

  test "a message with a time that cannot be is heard now", %{robot: robot, pulse: pulse} do
    for impossible <- [-1_000_000_000_000, 1_000_000_000_000] do
      hearing = Hearing.new(robot, @path, pulse, now())
      publish(robot, @path, now() + impossible)
      look = now()
      assert heard(hearing, look) == look
    end
  end

  test "each type of message is heard, also a later one", %{robot: robot, pulse: pulse} do
    publish(robot, @path, now())
    hearing = Hearing.new(robot, @path, pulse, now())
    time = now()
    publish(robot, @path, time, PowerState)
    assert heard(hearing, now()) == time
  end

  test "a silence after messages is one", %{robot: robot, pulse: pulse} do
    hearing = Hearing.new(robot, @path, pulse, now())
    time = now()
    publish(robot, @path, time)
    hearing = Hearing.look(hearing, now())
    for _ <- 1..3, do: assert(heard(hearing, now()) == time)
  end

  test "the pulse is heard as messages are", %{robot: robot, pulse: pulse} do
    hearing = Hearing.new(robot, @path, pulse, now())
    Pulse.adopt(pulse)
    time = now()
    :ok = Pulse.beat(time)
    assert heard(hearing, now()) == time
  end

  test "a bus that is not there is silent", %{robot: robot, pulse: pulse} do
    start = now()
    hearing = Hearing.new(robot, @path, pulse, start)
    stop_supervised!({PubSub, robot})
    assert heard(hearing, now()) == start
    assert Hearing.new(robot, @path, pulse, start).heard_ns == start
  end
end
