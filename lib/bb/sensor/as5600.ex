defmodule BB.Sensor.As5600 do
  alias BB.Bus.I2C.Device
  alias BB.Sensor.As5600.Registers
  alias BB.Sensor.Polled

  @own [
    from: [
      type: BB.Unit.option(:radian, -1000, 1000),
      default: -:math.pi(),
      doc:
        "The start of the turn in which the first angle lies: a number of rad or a unit of " <>
          "angle. The default is half a turn below 0."
    ],
    velocity_window: [
      type: BB.Unit.option(:second, 0.001, 10),
      default: 0.05,
      doc:
        "The time over which the velocity is measured: a number of s or a unit of time. A " <>
          "longer one is smoother, and later."
    ],
    filter: [
      type: {:in, Registers.filters()},
      default: 16,
      doc:
        "The chip's slow filter: 16, with 0.015° of noise and 2.2 ms to settle; 8; 4; or 2, " <>
          "with 0.043° and 0.3 ms."
    ],
    hysteresis: [
      type: {:in, 0..3},
      default: 0,
      doc: "In steps of the chip, of which a turn has 4096."
    ],
    magnet: [
      type: {:in, [:good, :any]},
      default: :good,
      doc: "`:any` also accepts a magnet that the chip reports as too weak or too strong."
    ]
  ]

  @schema Device.options(
            address: [0x36, 0x40],
            default: 0x36,
            doc: "0x36, or 0x40 for the AS5600L."
          ) ++
            Keyword.take(Polled.options(rate: {1, 1000}, default: 100), [:rate]) ++ @own

  @moduledoc """
  The ams AS5600 on I2C: the angle of a magnet on a shaft (datasheet v1-06).

  Use it as a sensor of a joint.

      joint :shoulder do
        sensor :encoder, {BB.Sensor.As5600, bus: "i2c-1"} do
          transmission do
            reduction 50.0
            offset ~u(5 degree)
          end
        end
      end

  It publishes `BB.Message.Sensor.JointState`: position in rad and velocity in rad/s, in the space
  of the joint to which it is attached, through the sensor's transmission
  (`BB.Sensor.publish_joint_state/3`). The first message after a start has no velocity.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Turns

  The chip measures the angle within a turn, in 4096 steps of 0.088°. The sensor counts the turns,
  so the position continues beyond the turn in which it began. That turn begins at `from`, which
  is in the sensor's space. The transmission's `offset` is in the joint's space.

  The count starts again with the sensor, also after a fault. A joint that turns more than once,
  its reduction included, has to be referenced after each start, for example at a limit switch. A
  joint that turns less than once needs nothing. A changed parameter loses no turn.

  The shaft may turn by three eighths of a turn from one reading to the next: 37 turns a second at
  100 Hz. When it may have been more, the count is lost. That is the fault `:too_fast`, and the
  sensor starts again.

  ## Faults

  A magnet that is missing, too weak or too strong is a fault, and the sensor is down while it
  lasts. The chip has no identity. A chip that does not keep settings as it does is
  `:not_configured`. Each reading checks the settings, so a chip that lost its power is set up
  again at once. `BB.Sensor.Polled` describes the other faults.

  A reading makes two transfers, of 8 and 5 bytes: 0.3 ms at 400 kHz.
  """

  use Polled, options_schema: @schema

  alias BB.Sensor.As5600.Track

  @enforce_keys [:device, :settings, :magnet, :track]
  defstruct [:device, :settings, :magnet, :track, :conf]

  @typedoc """
  Why the sensor does not work: a reason of every device (`t:BB.Bus.I2C.Device.reason/0`), a fault
  of the magnet, or `:too_fast`, when the shaft has turned too far from one reading to the next.
  The bus comes first, then the address.
  """
  @type reason ::
          Device.reason()
          | {:no_magnet | :magnet_too_weak | :magnet_too_strong | :too_fast, String.t(),
             Device.address()}

  @doc """
  Formats a reason as a sentence that says what to check.

      iex> BB.Sensor.As5600.explain({:no_magnet, "i2c-1", 0x36})
      "the encoder at 0x36 on i2c-1 detects no magnet: put one above the middle of the chip"
  """
  @impl BB.Sensor
  @spec explain(reason()) :: String.t()
  def explain({:no_magnet, bus, address}),
    do: encoder(bus, address, "detects no magnet: put one above the middle of the chip")

  def explain({:magnet_too_weak, bus, address}),
    do: encoder(bus, address, "has too weak a magnet: bring it nearer, or use a stronger one")

  def explain({:magnet_too_strong, bus, address}),
    do: encoder(bus, address, "has too strong a magnet: move it away, or use a weaker one")

  def explain({:too_fast, bus, address}),
    do:
      encoder(
        bus,
        address,
        "has turned too far between two readings, and its turns are no longer known: use a " <>
          "higher rate"
      )

  def explain(reason), do: Device.explain(reason)

  defp encoder(bus, address, trouble),
    do: "the encoder at #{Device.place(bus, address)} #{trouble}"

  @impl Polled
  def open(opts) do
    Device.open(opts, fn device ->
      start(%__MODULE__{
        device: device,
        settings: %{filter: opts[:filter], hysteresis: opts[:hysteresis]},
        magnet: opts[:magnet],
        track: Track.new(opts[:from], opts[:velocity_window])
      })
    end)
  end

  # A wrong magnet fails the start, so that the sensor does not go up and down.
  defp start(chip) do
    with {:ok, found} <- Device.read(chip.device, Registers.conf(), 2),
         chip = %{chip | conf: Registers.encode_conf(chip.settings, found)},
         :ok <- put_conf(chip, Registers.inverted(chip.conf)),
         :ok <- put_conf(chip, chip.conf),
         :ok <- check_state(chip),
         do: {:ok, chip}
  end

  defp put_conf(chip, conf) do
    with :ok <- Device.write(chip.device, Registers.conf(), conf),
         do: Device.expect(chip.device, Registers.conf(), conf, :not_configured)
  end

  @impl BB.Sensor
  def handle_options(opts, sensor) do
    with {:ok, %{device: chip} = new} <- Polled.handle_options(opts, sensor),
         do: {:ok, %{new | device: keep_track(chip, sensor.device)}}
  end

  defp keep_track(new, old) do
    if Device.same_place?(new.device, old.device),
      do: %{new | track: Track.continue(new.track, old.track)},
      else: new
  end

  @impl Polled
  def measure(chip, now_ns) do
    with :ok <- check_state(chip),
         {:ok, bytes} <- Device.read(chip.device, Registers.raw_angle(), 2),
         do: track(chip, Registers.decode_angle(bytes), now_ns)
  end

  defp check_state(chip) do
    with {:ok, bytes} <- Device.read(chip.device, Registers.conf(), Registers.state_size()) do
      {conf, magnet} = Registers.decode_state(bytes)
      if conf == chip.conf, do: check_magnet(magnet, chip), else: error(chip, :restarted)
    end
  end

  defp check_magnet(:missing, chip), do: error(chip, :no_magnet)
  defp check_magnet(:too_weak, %{magnet: :good} = chip), do: error(chip, :magnet_too_weak)
  defp check_magnet(:too_strong, %{magnet: :good} = chip), do: error(chip, :magnet_too_strong)
  defp check_magnet(_accepted, _chip), do: :ok

  defp error(chip, kind), do: {:error, Device.fault(chip.device, kind)}

  defp track(chip, angle, now_ns) do
    case Track.add(chip.track, angle, now_ns) do
      {:ok, reading, track} -> {:ok, reading, %{chip | track: track}}
      {:error, :too_fast} -> {:stop, Device.fault(chip.device, :too_fast)}
    end
  end

  @impl Polled
  def publish(reading, sensor) do
    BB.Sensor.publish_joint_state(sensor.bb.robot, sensor.bb.path,
      positions: [reading.position],
      velocities: List.wrap(reading.velocity)
    )
  end

  @impl Polled
  def close(chip), do: Device.close(chip.device)
end
