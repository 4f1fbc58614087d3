defmodule BB.Firmware.Guard.ChecksTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Firmware.Guard.Checks
  alias BB.Firmware.Network.None

  defp checks(robot) do
    topic = "guard_checks_#{System.unique_integer([:positive])}_#{System.pid()}"
    on_exit(fn -> File.rm("/dev/shm/conduit_" <> topic) end)
    Checks.new(robot, topic: topic, network: {None, []}, reach: :none, fresh_ms: 500)
  end

  defp seen(events, check), do: Enum.filter(events, &(elem(&1, 1) == check))

  defp restart(robot, name) do
    before = health(robot, name).restarts
    Process.exit(BB.Process.whereis(robot, name), :kill)
    assert eventually(fn -> restarted?(health(robot, name), before) end, 30_000)
  end

  defp restarted?(row, before), do: row.state == :up and row.restarts > before

  test "a required sensor that was started again between two looks is bad, although it is up" do
    robot = robot(do: sensors(do: sensor(:range, BB.Test.Probe, required: true)))
    start_supervised!(robot)
    assert eventually(fn -> health(robot, :range).state == :up end, 30_000)
    {checks, events} = Checks.run(checks(robot))
    assert seen(events, {:sensor, :range}) == []

    restart(robot, :range)
    {checks, events} = Checks.run(checks)
    assert [{:bad, _check, "was started again: " <> why}] = seen(events, {:sensor, :range})
    assert why =~ "killed"

    {checks, events} = Checks.run(checks)
    assert seen(events, {:sensor, :range}) == []
    Checks.close(checks)
  end

  test "a native process that was started again between two looks is bad, although it is up" do
    robot =
      robot(
        do:
          sensors(do: sensor(:native, {BB.Sensor.NativeProcess, program: "sleep", args: ["600"]}))
      )

    start_supervised!(robot)
    assert eventually(fn -> health(robot, :native).state == :up end, 30_000)
    {checks, events} = Checks.run(checks(robot))
    assert seen(events, {:native, :native}) == [{:good, {:native, :native}}]

    restart(robot, :native)
    {checks, events} = Checks.run(checks)
    assert [{:bad, _check, "was started again: " <> _why}] = seen(events, {:native, :native})
    Checks.close(checks)
  end
end
