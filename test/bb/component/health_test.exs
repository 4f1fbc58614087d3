defmodule BB.Component.HealthTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
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

    test "keeps the last error of a sensor that is up again" do
      robot = start_up(one_of_three())
      assert %{last_error: nil} = health(robot, :imu)
      imu(robot, handle_cast: fn :stop, state -> {:stop, :unplugged, state} end)
      BB.cast(robot, :imu, :stop)
      assert_status(robot, :imu, %{state: :backoff})
      assert eventually(fn -> health(robot, :imu).state == :up end)
      assert %{reason: nil, last_error: :unplugged} = health(robot, :imu)
    end

    test "has the last error as the driver formats it, and the rate declared for its parameters" do
      robot =
        robot do
          parameters do
            param :rate, type: :integer, default: 50
          end

          sensors do
            sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-of-no-robot", rate: param([:rate])}
          end
        end

      start_watched(robot, replay: true)
      assert_status(robot, :imu, %{state: :backoff})
      assert %{declared_hz: 50, rate_hz: nil, age_ns: nil, error: error} = health(robot, :imu)

      assert error ==
               "no bus i2c-of-no-robot: check its name, and that it is enabled"

      :ok = BB.Parameter.set(robot, [:rate], 20)
      assert health(robot, :imu).declared_hz == 20
    end

    test "has the measured rate of a sensor, and the age of its last message" do
      robot = start_up(one_of_three())
      {:ok, _} = BB.subscribe(robot, [:sensor, :first])
      :first |> first_count() |> then(&count_on(:first, &1, 20))
      assert %{rate_hz: rate_hz, age_ns: age_ns, declared_hz: nil} = health(robot, :first)
      assert rate_hz > 0 and age_ns >= 0
      assert %{rate_hz: nil, age_ns: nil, error: nil} = health(robot, :imu)
    end

    test "of a robot that is not started raises" do
      robot = one_of_three()
      message = ~r/^robot .* is not started; start it .*start_link\(\)$/
      assert_raise ArgumentError, message, fn -> BB.Sensor.health(robot) end
    end
  end
end
