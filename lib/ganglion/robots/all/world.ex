defmodule Ganglion.Robots.All.World do
  @moduledoc """
  The simulated devices of `Ganglion.Robots.All`: two I2C buses and a chip of GPIO lines.

  The robot declares them in `simulation`, and `bin/chaos sensors` finds by them which wire to
  break.

      Ganglion.Robots.All.World.places()[:battery]
      #=> {:i2c, "i2c-1", 0x40}
  """

  alias BB.Bus.Sim

  @typedoc "The place of a sensor's device: an address on an I2C bus, or lines of a chip."
  @type place ::
          {:i2c, bus :: String.t(), address :: byte()}
          | {:gpio, chip :: String.t(), device :: atom(), lines :: [non_neg_integer()]}

  @motor_velocity 40.0

  @i2c [
    {:imu, "i2c-1", 0x68, {Sim.Mpu6050, source: :motion}},
    {:battery, "i2c-1", 0x40, {Sim.Ina219, source: [voltage: 11.1, current: 1.5]}},
    {:motors, "i2c-2", 0x41, {Sim.Ina219, source: [voltage: 11.0, current: 0.8]}},
    {:elbow, "i2c-2", 0x36, {Sim.As5600, source: [angle: 0.7]}},
    {:lidar, "i2c-2", 0x10, {Sim.TfLuna, source: [distance: 2.5]}}
  ]

  @gpio [
    left_encoder: {Sim.Encoder, pins: [a: 5, b: 6], pulses: 11, velocity: @motor_velocity},
    right_encoder: {Sim.Encoder, pins: [a: 12, b: 13], pulses: 11, velocity: -@motor_velocity},
    sonar: {Sim.HcSr04, pins: [trigger: 23, echo: 24], distance: 1.2},
    bumper_left: {Sim.Contact, pins: [contact: 17]},
    bumper_right: {Sim.Contact, pins: [contact: 22]},
    estop: {Sim.Contact, pins: [contact: 27], normally: :closed}
  ]

  @chip "gpiochip0"

  @doc "Returns the I2C buses, each with its devices by address."
  @spec buses() :: %{String.t() => [{byte(), Sim.device()}]}
  def buses do
    for {_sensor, bus, address, device} <- @i2c, reduce: %{} do
      buses -> Map.update(buses, bus, [{address, device}], &[{address, device} | &1])
    end
  end

  @doc "Returns the name of the chip of GPIO lines."
  @spec chip() :: String.t()
  def chip, do: @chip

  @doc "Returns the devices on the lines of the chip, by name."
  @spec lines() :: [{atom(), Sim.Lines.device()}]
  def lines, do: @gpio

  @doc "Returns the place of each sensor's device. The sensor `:board` has none."
  @spec places() :: %{atom() => place()}
  def places do
    i2c = for {sensor, bus, address, _device} <- @i2c, do: {sensor, {:i2c, bus, address}}

    gpio =
      for {sensor, {_model, opts}} <- @gpio,
          do: {sensor, {:gpio, @chip, sensor, Keyword.values(opts[:pins])}}

    Map.new(i2c ++ gpio)
  end
end
