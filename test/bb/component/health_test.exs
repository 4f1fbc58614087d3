defmodule BB.Component.HealthTest do
  use ExUnit.Case, async: true

  import BB.Test.Watch

  alias BB.Test.Probe

  describe "health" do
    test "lists all sensors in the order of their declaration" do
      robot = start_up(one_of_three())
      assert [first, imu, second] = BB.Sensor.health(robot)
      assert {first.name, imu.name, second.name} == {:first, :imu, :second}

      assert %{
               path: [:base, :imu],
               module: Probe,
               required: false,
               state: :up,
               restarts: 0,
               reason: nil,
               retry_in_ms: nil,
               since: since
             } = imu

      assert imu.pid == pid(robot, :imu)
      assert since <= System.monotonic_time(:nanosecond)
    end

    test "of a robot that is not started raises" do
      robot = one_of_three()
      assert_raise ArgumentError, ~r/not started/, fn -> BB.Sensor.health(robot) end
    end
  end
end
