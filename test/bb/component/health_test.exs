defmodule BB.Component.HealthTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot, only: [health: 2]
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

    test "tells the last error of a sensor also when it is up again" do
      robot = start_up(one_of_three())
      assert %{last_error: nil} = health(robot, :imu)
      imu(robot, handle_cast: fn :stop, state -> {:stop, :unplugged, state} end)
      BB.cast(robot, :imu, :stop)
      assert_status(robot, :imu, %{state: :backoff})
      assert eventually(fn -> health(robot, :imu).state == :up end)
      assert %{reason: nil, last_error: :unplugged} = health(robot, :imu)
    end

    test "of a robot that is not started raises" do
      robot = one_of_three()
      assert_raise ArgumentError, ~r/not started/, fn -> BB.Sensor.health(robot) end
    end
  end
end
