defmodule BB.Sensor.Mpu6050 do
  alias BB.Sensor.Mpu6050.{Chip, DataReady, Registers}

  @own [
    model: [
      type: {:in, [nil | Registers.models()]},
      default: nil,
      doc:
        "`:mpu6050`, `:mpu6500` or `:mpu9250`, and no other; when `nil`, whichever of them it is."
    ],
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
    ],
    fifo: [
      type: :boolean,
      default: false,
      doc: "Whether samples wait in the chip's FIFO until they are read; needs `:interrupt`."
    ]
  ]

  @schema BB.Bus.I2C.Device.options(
            address: [0x68, 0x69],
            default: 0x68,
            doc: "0x68, or 0x69 where the pin AD0 is high."
          ) ++
            BB.Sensor.Polled.options(rate: {4, 1000}, default: 100) ++
            @own ++ DataReady.options()

  @moduledoc """
  The InvenSense MPU-6050, and its successors MPU-6500 and MPU-9250: acceleration and rotation in three axes, on I2C.

      sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1", rate: ~u(200 hertz), filter: 94}

      sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1", rate: ~u(1 kilohertz), filter: 184, interrupt: {"gpiochip0", 4}, fifo: true}

  Publishes `BB.Message.Sensor.Imu` in the chip's axes: m/s² and rad/s. The chip does not know its orientation, so that is the
  identity with `BB.Math.Covariance3.unavailable/0`, as ROS has it; the other covariances are `nil`, unknown.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Rates
  Without `interrupt:` the message rate is exactly `rate`, kept by `BB.Loop`. The chip itself samples at 1000 Hz (8000 Hz with the filter 260) divided
  by 1 to 256, and is set to the slowest such rate that is not below `rate`: 100 Hz for 100 Hz, 333.3 Hz for 300 Hz. What is
  published is the chip's latest sample at the time of reading, at most one of its periods old. The two clocks are not one, so at
  equal rates a sample may be left out or be read twice once in a while; a rate that the chip exceeds has no such doubles.

  ## Each sample, with its own time
  With `interrupt:` the chip sets the pace. Its pin INT, wired to that line, tells of each sample, and the message of a sample has the time at
  which the kernel saw the edge, put on the robot's clock (`BB.Sensor.Mpu6050.Stamps`). The message rate is then the chip's own rate, the slowest that
  is not below `rate`, by the chip's clock. A sample that is not read before the next one comes is left out.

  With `fifo: true` too none is: samples wait in the chip, for up to 73 ms at 1 kHz (36 ms in the successors). If that is not enough the sensor stops with
  the reason `:overflow`, and begins anew. A reading costs two short transfers more, and reads all samples that wait.

  No edge at all, at the start or for three looks (which are 50 ms apart, or two samples), is the reason `:no_interrupt`.

  ## What goes wrong
  A reading is published when it was read, or not at all. After three failed readings in a row the sensor stops, with a reason of
  `t:BB.Sensor.Mpu6050.DataReady.reason/0`, and is started again as its robot's supervision says. A chip that lost its power for a moment has
  forgotten its settings: each reading looks for one of them, and the sensor stops at once to set it up again.

  Starting identifies and resets the chip, waits 100 ms, wakes it, sets it and reads the settings back, and waits 30 ms until the
  gyroscope has settled. The sensor is up when that is done, and the first reading follows within a period.

  With one sensor a tick costs one transfer of 18 bytes: 0.5 ms at 400 kHz.
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
    do: "fifo: true needs interrupt: set it to the line that the pin INT is wired to"

  def explain(reason) when DataReady.is_reason(reason), do: DataReady.explain(reason)
  def explain(reason), do: Device.explain(reason)

  @impl BB.Sensor
  def rate(opts) do
    if opts[:interrupt], do: sample_rate_hz(opts), else: opts[:rate]
  end

  @impl BB.Sensor.Polled
  def pace(opts) do
    if opts[:interrupt], do: DataReady.looks_hz(sample_rate_hz(opts)), else: opts[:rate]
  end

  defp sample_rate_hz(opts),
    do: opts[:rate] |> Registers.divider(opts[:filter]) |> Registers.sample_rate_hz(opts[:filter])

  @impl BB.Sensor.Polled
  def open(opts) do
    pulses? = opts[:interrupt] != nil

    if opts[:fifo] and not pulses?,
      do: {:error, :fifo_without_interrupt},
      else: Device.open(opts, &prepare(&1, opts, pulses?))
  end

  defp prepare(device, opts, pulses?) do
    chip = %Chip{device: device, settings: settings(opts), pulses?: pulses?}

    with {:ok, chip} <- start(chip, opts[:model]),
         do: if(pulses?, do: DataReady.open(chip, opts, clock(opts)), else: {:ok, chip})
  end

  defp clock(opts), do: Clock.of(opts[:bb].robot)

  # The waits are the data sheet's.
  defp start(chip, model) do
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
  def measure(%DataReady{} = device, _now_ns), do: DataReady.look(device)

  def measure(chip, _now_ns) do
    with {:ok, reading, _new?} <- Chip.sample(chip), do: {:ok, [{nil, reading}], chip}
  end

  @impl BB.Sensor
  def handle_info({:circuits_gpio, _spec, edge_ns, _level}, %{device: %DataReady{}} = sensor) do
    device = DataReady.heard(sensor.device, edge_ns)
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
