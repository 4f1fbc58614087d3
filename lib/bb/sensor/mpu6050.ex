defmodule BB.Sensor.Mpu6050 do
  alias BB.Sensor.Mpu6050.Registers

  @rates_hz 4..1000

  @schema [
    bus: [type: :string, required: true, doc: "The I2C bus, such as `\"i2c-1\"`."],
    address: [
      type: {:in, [0x68, 0x69]},
      default: 0x68,
      doc: "0x68, or 0x69 where the pin AD0 is high."
    ],
    rate: [
      type: {:custom, __MODULE__, :check_rate, []},
      default: 100,
      doc: "Readings a second: a number or a unit of frequency, 4 Hz to 1 kHz."
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
    timeout: [
      type: :pos_integer,
      default: 20,
      doc:
        "How long a transfer may hold the bus, in milliseconds; the kernel counts in steps of 10."
    ],
    frame_id: [
      type: {:or, [:atom, nil]},
      default: nil,
      doc: "The messages' frame; the sensor's name when `nil`."
    ],
    i2c: [
      type: {:or, [:module, nil]},
      default: nil,
      doc: "The bus's module; when `nil`, that of `BB.Bus.I2C.module/1`."
    ]
  ]

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
  A reading is published when it was read, or not at all. After three failed readings in a row the sensor stops, with a
  `t:reason/0`, and is started again as its robot's supervision says. A chip that lost its power for a moment is asleep and shows
  zeros: that is noticed, and the sensor stops at once to set it up again. `explain/1` puts a reason in words.

  Starting identifies and resets the chip, waits 100 ms, wakes it, sets it and reads the settings back, and waits 30 ms until the
  gyroscope has settled. The sensor is up when that is done, and the first reading follows within a period.

  With one sensor a tick costs one transfer of 14 bytes: 0.4 ms at 400 kHz.
  """

  use BB.Sensor, options_schema: @schema

  alias BB.{Loop, Message}
  alias BB.Math.{Covariance3, Quaternion, Vec3}
  alias BB.Message.Sensor.Imu
  alias BB.Sensor.Mpu6050.Chip

  @most_failures 3

  @typedoc """
  Why the sensor does not work; bus, then address:

  - `:no_answer`: nobody acknowledges the address;
  - `:timeout`: a transfer held the bus for its whole timeout;
  - `:bus_not_found`: there is no such bus;
  - `:wrong_chip`: WHO_AM_I is `found` instead of `expected`;
  - `:not_configured`: the chip did not keep its settings when they were written;
  - `:restarted`: it was reset or lost its power while in use;
  - `:bus`: another error of the bus, as the bus's module gave it.
  """
  @type reason ::
          {:no_answer, String.t(), byte()}
          | {:timeout, String.t(), byte()}
          | {:bus_not_found, String.t()}
          | {:wrong_chip, String.t(), byte(), found :: byte(), expected :: byte()}
          | {:not_configured, String.t(), byte()}
          | {:restarted, String.t(), byte()}
          | {:bus, String.t(), byte(), error :: term()}

  @doc """
  A reason in a sentence that says what to look at.

      iex> BB.Sensor.Mpu6050.explain({:no_answer, "i2c-1", 0x68})
      "no answer at 0x68 on i2c-1: check wiring and power"
      iex> BB.Sensor.Mpu6050.explain({:wrong_chip, "i2c-1", 0x68, 0x70, 0x68})
      "the chip at 0x68 on i2c-1 identifies itself as 0x70, an MPU-6050 as 0x68: check the part and the address"
  """
  @impl BB.Sensor
  @spec explain(reason()) :: String.t()
  def explain({:no_answer, bus, address}),
    do: "no answer at #{place(bus, address)}: check wiring and power"

  def explain({:timeout, bus, address}),
    do:
      "a transfer with #{place(bus, address)} did not end in time: check pull-ups, wiring and the other devices on the bus"

  def explain({:bus_not_found, bus}),
    do: "there is no bus #{bus}: check its name, and that it is enabled"

  def explain({:wrong_chip, bus, address, found, expected}),
    do:
      "the chip at #{place(bus, address)} identifies itself as #{hex(found)}, an MPU-6050 as #{hex(expected)}: " <>
        "check the part and the address"

  def explain({:not_configured, bus, address}),
    do:
      "the chip at #{place(bus, address)} did not keep its settings: check its power and for a second device at the address"

  def explain({:restarted, bus, address}),
    do:
      "the chip at #{place(bus, address)} was reset or lost its power while in use: check its supply"

  def explain({:bus, bus, address, error}),
    do:
      "a transfer with #{place(bus, address)} failed with #{inspect(error)}: look at the kernel's log"

  defp place(bus, address), do: "#{hex(address)} on #{bus}"
  defp hex(byte), do: "0x" <> String.pad_leading(Integer.to_string(byte, 16), 2, "0")

  @doc false
  def check_rate(rate) do
    with {:ok, hz} <- hertz(rate), true <- hz >= @rates_hz.first and hz <= @rates_hz.last do
      {:ok, hz}
    else
      _ ->
        {:error,
         "expected a rate of #{@rates_hz.first} to #{@rates_hz.last} Hz, as a number or a unit, got: #{inspect(rate)}"}
    end
  end

  defp hertz(%BB.Unit{} = rate) do
    with {:ok, %{value: hz}} <- BB.Unit.convert(rate, "hertz"), do: {:ok, hz}
  end

  defp hertz(rate) when is_number(rate), do: {:ok, rate}
  defp hertz(_), do: :error

  @impl BB.Sensor
  def rate(opts), do: opts[:rate]

  @impl BB.Sensor
  def init(opts) do
    case start(opts) do
      {:ok, sensor} -> {:ok, sensor}
      {:error, reason} -> {:stop, reason}
    end
  end

  @impl BB.Sensor
  def handle_options(opts, sensor) do
    stop(sensor)
    init(opts)
  end

  @impl BB.Sensor
  def handle_info(:tick, sensor), do: tick(sensor)
  def handle_info(_late, sensor), do: {:noreply, sensor}

  @impl BB.Sensor
  def terminate(_reason, sensor), do: stop(sensor)

  # Starting and stopping.

  defp start(opts) do
    with {:ok, chip} <- open(opts) do
      case begin(chip) do
        :ok -> {:ok, new(chip, opts)}
        error -> close(chip, error)
      end
    end
  end

  # The waits are the data sheet's. Nobody waits with the sensor: `init` runs in its own process.
  defp begin(chip) do
    with :ok <- Chip.identify(chip),
         :ok <- Chip.reset(chip),
         :ok <- Process.sleep(Chip.reset_ms()),
         :ok <- Chip.configure(chip),
         do: Process.sleep(Chip.settle_ms())
  end

  defp close(chip, error) do
    Chip.close(chip)
    error
  end

  defp open(opts) do
    i2c = BB.Bus.I2C.module(opts[:i2c])
    Chip.open(i2c, opts[:bus], opts[:address], opts[:timeout], settings(opts))
  end

  defp settings(opts) do
    %{
      divider: Registers.divider(opts[:rate], opts[:filter]),
      filter: opts[:filter],
      gyro_range: opts[:gyro_range],
      accel_range: opts[:accel_range]
    }
  end

  defp new(chip, opts) do
    bb = opts[:bb]

    %{
      bb: bb,
      chip: chip,
      frame_id: opts[:frame_id] || List.last(bb.path),
      loop: bb |> Loop.new(clock: {:rate, opts[:rate]}) |> Loop.arm(),
      failures: 0
    }
  end

  defp stop(sensor) do
    _ = Loop.cancel(sensor.loop)
    Chip.close(sensor.chip)
  end

  # Measuring.

  defp tick(sensor) do
    {_dt, _skipped, loop} = Loop.tick(sensor.loop)
    sensor = %{sensor | loop: loop}

    case read(sensor) do
      {:ok, reading} -> publish(reading, sensor)
      {:error, reason} -> failed(reason, sensor)
    end
  end

  # What answers after a failure may be a chip that was plugged in anew.
  defp read(%{failures: 0} = sensor), do: Chip.sample(sensor.chip)
  defp read(sensor), do: with(:ok <- Chip.check_awake(sensor.chip), do: Chip.sample(sensor.chip))

  defp publish(reading, sensor) do
    message = Message.new!(Imu, sensor.frame_id, imu(reading))
    BB.Sensor.publish(sensor.bb, message)
    {:noreply, %{sensor | failures: 0}}
  end

  defp failed({:restarted, _bus, _address} = reason, sensor),
    do: {:stop, {:shutdown, reason}, sensor}

  defp failed(reason, %{failures: failures} = sensor) when failures + 1 >= @most_failures,
    do: {:stop, {:shutdown, reason}, sensor}

  defp failed(_reason, sensor), do: {:noreply, %{sensor | failures: sensor.failures + 1}}

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
