defmodule BB.Process.NameTest do
  use ExUnit.Case, async: true

  import BB.Test.Robot

  alias BB.Process.Name

  doctest BB.Process.Name

  defmodule OwnRegistry do
    @moduledoc false
  end

  test "the names have the registry of the robot's settings" do
    robot = create(quote(do: settings(registry_module: unquote(OwnRegistry))))
    assert Name.via(robot, :imu) == {:via, OwnRegistry, {Module.concat(robot, Registry), :imu}}
    assert Name.via(robot, :imu) == BB.Process.via(robot, :imu)
    assert Name.registry_module(SomeRobot) == Registry
    assert Name.setting(robot, :registry_options, []) == []
  end
end
