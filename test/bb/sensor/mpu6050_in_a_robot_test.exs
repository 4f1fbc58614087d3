defmodule BB.Sensor.Mpu6050InARobotTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually

  alias BB.Bus.Sim
  alias BB.Message.Sensor.{Imu, Status}

  @bus "i2c-mpu-in-a-robot"
  @patience_ms 60_000

  defmodule Robot do
    use BB

    topology do
      link :base_link do
        sensor(:imu, {BB.Sensor.Mpu6050, bus: "i2c-mpu-in-a-robot", rate: ~u(200 hertz)})
        sensor(:spare, {BB.Sensor.Mpu6050, bus: "i2c-mpu-in-a-robot", rate: 100, address: 0x69})
      end
    end
  end

  setup do
    device = {Sim.Mpu6050, source: :motion}
    start_supervised!({Sim, buses: %{@bus => [devices: %{0x68 => device, 0x69 => device}]}})
    :ok
  end

  defp start_robot do
    start_supervised!(Robot)
    {:ok, _} = BB.subscribe(Robot, [:sensor, :base_link, :imu])
    {:ok, _} = BB.subscribe(Robot, [:sensor_status, :base_link, :imu])
  end

  defp receive_imu do
    assert_receive {:bb, [:sensor, :base_link, :imu], %{payload: %Imu{}} = message}, @patience_ms
    message
  end

  defp receive_status(within_ms \\ @patience_ms) do
    assert_receive {:bb, [:sensor_status, :base_link, :imu], %{payload: %Status{} = status}},
                   within_ms

    status
  end

  defp health(name), do: Enum.find(BB.Sensor.health(Robot), &(&1.name == name))

  defp drain do
    receive do
      {:bb, _, %{payload: %Imu{}}} -> drain()
    after
      0 -> :ok
    end
  end

  test "an unplugged IMU is in backoff, and up within a second of being plugged in again" do
    start_robot()
    receive_imu()
    {:ok, _} = BB.subscribe(Robot, [:sensor, :base_link, :spare])
    assert_receive {:bb, [:sensor, :base_link, :spare], _}, @patience_ms
    %{pid: spare} = health(:spare)

    :ok = Sim.unplug(@bus, 0x68)
    status = receive_status_of(:backoff)
    assert status.reason == {:no_answer, @bus, 0x68}
    assert %{state: :backoff, reason: {:no_answer, @bus, 0x68}} = health(:imu)
    drain()

    :ok = Sim.replug(@bus, 0x68)
    assert receive_status(1000).state == :up
    receive_imu()
    assert %{state: :up, pid: imu} = health(:imu)
    assert is_pid(imu)
    assert %{state: :up, pid: ^spare, restarts: 0} = health(:spare)
  end

  defp receive_status_of(state) do
    case receive_status() do
      %{state: ^state} = status -> status
      _ -> receive_status_of(state)
    end
  end

  test "an IMU that is absent when the robot starts publishes once it is plugged in" do
    :ok = Sim.unplug(@bus, 0x68)
    start_robot()
    assert_receive_down()
    refute_received {:bb, [:sensor, :base_link, :imu], _}

    :ok = Sim.replug(@bus, 0x68)
    receive_imu()
    assert health(:imu).state == :up
  end

  # It may be down before this test has subscribed.
  defp assert_receive_down do
    if health(:imu).state != :backoff, do: receive_status_of(:backoff)
    assert health(:imu).reason == {:no_answer, @bus, 0x68}
  end

  test "a bus that is missing when the robot starts is no reason for it not to start" do
    stop_supervised!({Sim, [@bus]})
    start_robot()
    if health(:imu).state != :backoff, do: receive_status_of(:backoff)
    assert health(:imu).reason == {:bus_not_found, @bus}

    start_supervised!({Sim, buses: %{@bus => [devices: %{0x68 => {Sim.Mpu6050, []}}]}})
    receive_imu()

    # Before the bus, whose end would otherwise reach the next test.
    stop_supervised!(Robot)
  end

  test "a stuck bus takes all of its sensors down, and they are up again after its release" do
    start_robot()
    receive_imu()
    :ok = Sim.stuck(@bus)
    assert receive_status_of(:backoff).reason == {:timeout, @bus, 0x68}
    assert eventually(fn -> health(:spare).state == :backoff end)
    assert %{state: :down, error: :timeout} = eventually(fn -> bus_that_is(:down) end)

    :ok = Sim.release(@bus)
    assert eventually(fn -> health(:imu).state == :up and health(:spare).state == :up end)
    assert %{error: nil} = bus_that_is(:up)
  end

  defp bus_that_is(state),
    do: Enum.find(BB.Bus.I2C.health(), &(&1.bus == @bus and &1.state == state))

  test "a brief loss of power is detected, and the IMU set up again" do
    start_robot()
    receive_imu()
    :ok = Sim.unplug(@bus, 0x68)
    :ok = Sim.replug(@bus, 0x68)
    assert %{reason: {:restarted, @bus, 0x68}} = receive_status_of(:backoff)
    drain()
    assert %{linear_acceleration: acceleration} = receive_imu().payload
    assert_in_delta BB.Math.Vec3.norm(acceleration), 9.81, 0.1
  end
end
