defmodule BB.Sensor.Mpu6050 do
  alias BB.Sensor.Mpu6050.Registers

  @own [
    accel_range: [
      type: {:in, Registers.accel_ranges()},
      default: 4,
      doc: "The accelerometer's full scale in g: 2, 4, 8 or 16, to either side."
    ],
    gyro_range: [
      type: {:in, Registers.gyro_ranges()},
      default: 500,
      doc:
        "The gyroscope's full scale in degrees a second: 250, 500, 1000 or 2000, to either side."
    ],
    filter: [
      type: {:in, Registers.filters()},
      default: 44,
      doc:
        "The low-pass filter's bandwidth in Hz: 5, 10, 20, 44, 94, 184, or 260 for none. Keep it below half the rate."
    ]
  ]

  @schema BB.Bus.I2C.Device.options(
            address: [0x68, 0x69],
            default: 0x68,
            doc: "0x68, or 0x69 where the pin AD0 is high."
          ) ++ BB.Sensor.Polled.options(rate: {4, 1000}, default: 100) ++ @own

  @moduledoc """
  The InvenSense MPU-6050: acceleration and rotation in three axes, on I2C.

      sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1", rate: ~u(200 hertz), filter: 94}

  Publishes `BB.Message.Sensor.Imu` in the chip's axes: m/s² and rad/s. The chip does not know its orientation, so that is the
  identity with `BB.Math.Covariance3.unavailable/0`, as ROS has it; the other covariances are `nil`, unknown.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Rates
  The message rate is exactly `rate`, kept by `BB.Loop`. The chip itself samples at 1000 Hz (8000 Hz with the filter 260) divided
  by 1 to 256, and is set to the slowest such rate that is not below `rate`: 100 Hz for 100 Hz, 333.3 Hz for 300 Hz. What is
  published is the chip's latest sample at the time of reading, at most one of its periods old. The two clocks are not one, so at
  equal rates a sample may be left out or be read twice once in a while; a rate that the chip exceeds has no such doubles.

  ## What goes wrong
  A reading is published when it was read, or not at all. After three failed readings in a row the sensor stops, with a reason of
  `t:BB.Bus.I2C.Device.reason/0`, and is started again as its robot's supervision says. A chip that lost its power for a moment is
  asleep and shows zeros: that is noticed, and the sensor stops at once to set it up again.

  Starting identifies and resets the chip, waits 100 ms, wakes it, sets it and reads the settings back, and waits 30 ms until the
  gyroscope has settled. The sensor is up when that is done, and the first reading follows within a period.

  With one sensor a tick costs one transfer of 14 bytes: 0.4 ms at 400 kHz.
  """

  use BB.Sensor.Polled, options_schema: @schema

  alias BB.Bus.I2C.Device
  alias BB.Math.{Covariance3, Quaternion, Vec3}
  alias BB.Message
  alias BB.Message.Sensor.Imu
  alias BB.Sensor.Mpu6050.Chip

  @impl BB.Sensor
  defdelegate explain(reason), to: Device

  @impl BB.Sensor.Polled
  def open(opts) do
    settings = settings(opts)
    Device.open(opts, &start(%Chip{device: &1, settings: settings}))
  end

  # The waits are the data sheet's.
  defp start(chip) do
    with :ok <- Chip.identify(chip),
         :ok <- Chip.reset(chip),
         :ok <- Process.sleep(Chip.reset_ms()),
         :ok <- Chip.configure(chip),
         :ok <- Process.sleep(Chip.settle_ms()),
         do: {:ok, chip}
  end

  defp settings(opts) do
    %{
      divider: Registers.divider(opts[:rate], opts[:filter]),
      filter: opts[:filter],
      gyro_range: opts[:gyro_range],
      accel_range: opts[:accel_range]
    }
  end

  @impl BB.Sensor.Polled
  def measure(chip, _now_ns) do
    with {:ok, reading} <- Chip.sample(chip), do: {:ok, reading, chip}
  end

  @impl BB.Sensor.Polled
  defdelegate check(chip), to: Chip, as: :check_awake

  @impl BB.Sensor.Polled
  defdelegate close(chip), to: Chip

  @impl BB.Sensor.Polled
  def publish(reading, sensor),
    do: BB.Sensor.publish(sensor.bb, Message.new!(Imu, sensor.frame_id, imu(reading)))

  defp imu(reading) do
    [
      orientation: Quaternion.identity(),
      orientation_covariance: Covariance3.unavailable(),
      angular_velocity: vec3(reading.angular_velocity),
      linear_acceleration: vec3(reading.acceleration)
    ]
  end

  defp vec3({x, y, z}), do: %Vec3{x: x, y: y, z: z}
end
