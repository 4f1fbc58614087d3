defmodule BB.Sensor.Mpu6050 do
  alias BB.Sensor.Mpu6050.{Chip, DataReady, Registers}

  @own [
    model: [
      type: {:in, [nil | Registers.models()]},
      default: nil,
      doc: "`:mpu6050`, `:mpu6500` or `:mpu9250`; when `nil`, any of them."
    ],
    accel_range: [
      type: {:in, Registers.accel_ranges()},
      default: 4,
      doc: "The accelerometer's full scale in g: ±2, ±4, ±8 or ±16."
    ],
    gyro_range: [
      type: {:in, Registers.gyro_ranges()},
      default: 500,
      doc: "The gyroscope's full scale in degrees a second: ±250, ±500, ±1000 or ±2000."
    ],
    filter: [
      type: {:in, Registers.filters()},
      default: 44,
      doc:
        "The low-pass filter's bandwidth in Hz: 5, 10, 20, 44, 94, 184, or 260 for none. Keep " <>
          "it below half the rate."
    ],
    fifo: [
      type: :boolean,
      default: false,
      doc: "Whether samples wait in the chip's FIFO until they are read. Needs `:interrupt`."
    ]
  ]

  @schema BB.Bus.I2C.Device.options(
            address: [0x68, 0x69],
            default: 0x68,
            doc: "0x68, or 0x69 when the pin AD0 is high."
          ) ++
            BB.Sensor.Polled.options(rate: {4, 1000}, default: 100) ++
            @own ++ DataReady.options()

  @moduledoc """
  The InvenSense MPU-6050 on I2C, and its successors MPU-6500 and MPU-9250: acceleration and
  rotation in three axes.

  Use it as the robot's IMU.

      sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1", rate: ~u(200 hertz), filter: 94}

      sensor :imu,
             {BB.Sensor.Mpu6050,
              bus: "i2c-1",
              rate: ~u(1 kilohertz),
              filter: 184,
              interrupt: {"gpiochip0", 4},
              fifo: true}

  It publishes `BB.Message.Sensor.Imu` in the chip's axes, in m/s² and rad/s. The chip does not
  measure its orientation, so that is the identity with `BB.Math.Covariance3.unavailable/0`, as in
  ROS. The other covariances are `nil`, unknown.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Rates

  Without `interrupt:` the message rate is exactly `rate`, by `BB.Loop`. The chip samples at 1000
  Hz (8000 Hz with the filter 260) divided by 1 to 256, and is set to the slowest such rate that
  is not below `rate`: 100 Hz for 100 Hz, 333.3 Hz for 300 Hz. The sensor publishes the chip's
  latest sample, at most one of the chip's periods old. Chip and robot have different clocks, so
  at equal rates a sample is left out or read twice now and then. At a rate below the chip's, no
  sample is read twice.

  ## The time of each sample

  With `interrupt:` the chip sets the rate. Its pin INT, wired to that line, signals each sample.
  The message of a sample has the kernel's timestamp of the edge, converted to the robot's clock
  (`BB.Sensor.Mpu6050.Stamps`). The message rate is then the chip's own rate, the slowest that is
  not below `rate`, by the chip's clock. A sample that is not read before the next one is left
  out.

  With `fifo: true` no sample is left out. Samples wait in the chip, for up to 73 ms at 1 kHz (36
  ms in the successors). If that is not enough, the sensor stops with the reason `:overflow` and
  starts again. A reading needs two more short transfers, and reads all samples that wait.

  The sensor checks for edges every 50 ms, or every two samples if that is longer. No edge at the
  start, or in three checks in a row, is the fault `:no_interrupt`.

  ## Faults

  After three failed readings in a row the sensor stops, with a
  `t:BB.Sensor.Mpu6050.DataReady.reason/0`, and its robot restarts it. A chip that lost its power
  for a moment has lost its settings. Each reading checks one of them, and the sensor stops at
  once, so that the chip is set up again.

  The start identifies and resets the chip, waits 100 ms, wakes it, writes the settings and reads
  them back, and waits 30 ms until the gyroscope has settled. Then the sensor is up, and the first
  reading follows within a period.

  A reading makes one transfer of 18 bytes: 0.5 ms at 400 kHz.
  """

  use BB.Sensor.Polled, options_schema: @schema

  alias BB.Bus.I2C.Device
  alias BB.Clock
  alias BB.Math.{Covariance3, Quaternion, Vec3}
  alias BB.Message
  alias BB.Message.Sensor.Imu
  alias BB.Sensor.Polled

  require DataReady

  @impl BB.Sensor
  def explain(:fifo_without_interrupt),
    do: "fifo: true needs interrupt: set it to the line of the pin INT"

  def explain(reason) when DataReady.is_reason(reason), do: DataReady.explain(reason)
  def explain(reason), do: Device.explain(reason)

  @impl BB.Sensor
  def rate(opts) do
    if opts[:interrupt], do: sample_rate_hz(opts), else: opts[:rate]
  end

  @impl BB.Sensor.Polled
  def poll_rate(opts) do
    if opts[:interrupt], do: DataReady.checks_hz(sample_rate_hz(opts)), else: opts[:rate]
  end

  defp sample_rate_hz(opts),
    do: opts[:rate] |> Registers.divider(opts[:filter]) |> Registers.sample_rate_hz(opts[:filter])

  @impl BB.Sensor.Polled
  def open(opts) do
    pulses? = opts[:interrupt] != nil

    if opts[:fifo] and not pulses?,
      do: {:error, :fifo_without_interrupt},
      else: Device.open(opts, &start(&1, opts, pulses?))
  end

  defp start(device, opts, pulses?) do
    chip = %Chip{device: device, settings: settings(opts), pulses?: pulses?}

    with {:ok, chip} <- set_up(chip, opts[:model]),
         do: if(pulses?, do: DataReady.open(chip, opts, clock(opts)), else: {:ok, chip})
  end

  defp clock(opts), do: Clock.of(opts[:bb].robot)

  # The waiting times are those of the datasheet.
  defp set_up(chip, model) do
    with {:ok, chip} <- Chip.identify(chip, model),
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
  def measure(%DataReady{} = device, _now_ns), do: DataReady.check_edges(device)

  def measure(chip, _now_ns) do
    with {:ok, reading, _new?} <- Chip.sample(chip), do: {:ok, [{nil, reading}], chip}
  end

  @impl BB.Sensor
  def handle_info({:circuits_gpio, _spec, edge_ns, _level}, %{device: %DataReady{}} = sensor) do
    device = DataReady.add_edge(sensor.device, edge_ns)
    device |> DataReady.read() |> Polled.outcome(%{sensor | device: device})
  end

  def handle_info(message, sensor), do: Polled.handle_info(message, sensor)

  @impl BB.Sensor.Polled
  def close(%DataReady{} = device), do: DataReady.close(device)
  def close(chip), do: Chip.close(chip)

  @impl BB.Sensor.Polled
  def publish(readings, sensor) do
    for {time_ns, reading} <- readings do
      times = if time_ns, do: [monotonic_time: time_ns], else: []
      message = Message.new!(Imu, sensor.frame_id, imu(reading), times)
      BB.Sensor.publish(sensor.bb, message)
    end

    :ok
  end

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
