defmodule BB.ProcessTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot, only: [robot: 1]

  alias BB.Test.Probe

  doctest BB.Process

  setup do
    robot =
      robot do
        sensors do
          sensor :sonar, BB.Test.Probe
        end
      end

    %{robot: robot}
  end

  test "via/2 names a component by robot and name", %{robot: robot} do
    registry = Module.concat(robot, Registry)
    assert BB.Process.registry_name(robot) == registry
    assert BB.Process.via(robot, :sonar) == {:via, Registry, {registry, :sonar}}
  end

  test "whereis/2 is the component's process, or :undefined", %{robot: robot} do
    start_supervised!(robot)
    pid = BB.Process.whereis(robot, :sonar)
    assert GenServer.whereis(BB.Process.via(robot, :sonar)) == pid
    assert BB.Process.whereis(robot, :nobody) == :undefined
    Probe.script(robot, :sonar, init: fn _ -> {:stop, :absent} end)
    Process.exit(pid, :kill)
    assert eventually(fn -> BB.Process.whereis(robot, :sonar) == :undefined end)
  end

  test "whereis/2 of a robot that is not started raises", %{robot: robot} do
    assert_raise ArgumentError, fn -> BB.Process.whereis(robot, :sonar) end
  end
end
