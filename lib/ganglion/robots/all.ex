defmodule Ganglion.Robots.All do
  @moduledoc """
  A robot with every driver that ships: twelve devices on two I2C buses, GPIO lines and the board.

  `bin/demo --robot all` runs it, and `bin/chaos sensors` breaks its wires.

      {:ok, _pid} = Ganglion.Robots.All.start_link()
      BB.Sensor.health(Ganglion.Robots.All)

  | sensor | what | where | declared |
  |---|---|---|---|
  | `:imu` | MPU-6050 | `i2c-1`, 0x68 | 100 Hz |
  | `:battery` | INA219 | `i2c-1`, 0x40 | 10 Hz |
  | `:motors` | INA219 | `i2c-2`, 0x41 | 10 Hz |
  | `:elbow` | AS5600 | `i2c-2`, 0x36 | 100 Hz |
  | `:lidar` | TF-Luna | `i2c-2`, 0x10 | 50 Hz |
  | `:left_encoder`, `:right_encoder` | quadrature encoders | lines 5 and 6, 12 and 13 | 50 Hz each |
  | `:sonar` | HC-SR04 | lines 23 and 24 | 10 Hz |
  | `:bumper_left`, `:bumper_right` | contacts | lines 17, 22 | 10 Hz each |
  | `:estop` | emergency stop, normally closed | line 27 | 50 Hz |
  | `:board` | the computer: load, memory, temperature | the kernel's files | 1 Hz |

  `Ganglion.Robots.All.World` has their simulated devices.
  """

  use BB

  alias BB.Sensor.{
    As5600,
    ContactSwitch,
    EmergencyStop,
    HcSr04,
    Ina219,
    Mpu6050,
    QuadratureEncoder,
    TfLuna
  }

  alias __MODULE__.World

  settings do
    name :all
  end

  sensors do
    sensor :battery, {Ina219, bus: "i2c-1"}, max_silence: ~u(500 millisecond)
    sensor :board, BB.Sensor.System, max_silence: ~u(5 second)
    sensor :motors, {Ina219, bus: "i2c-2", address: 0x41}, max_silence: ~u(500 millisecond)
  end

  topology do
    link :base_link do
      sensor :imu, {Mpu6050, bus: "i2c-1", rate: ~u(100 hertz)}, max_silence: ~u(200 millisecond)

      sensor :sonar, {HcSr04, trigger: {"gpiochip0", 23}, echo: {"gpiochip0", 24}},
        max_silence: ~u(500 millisecond)

      sensor :lidar, {TfLuna, bus: "i2c-2"}, max_silence: ~u(200 millisecond)

      sensor :bumper_left, {ContactSwitch, line: {"gpiochip0", 17}},
        max_silence: ~u(500 millisecond)

      sensor :bumper_right, {ContactSwitch, line: {"gpiochip0", 22}},
        max_silence: ~u(500 millisecond)

      sensor :estop, {EmergencyStop, line: {"gpiochip0", 27}}, max_silence: ~u(200 millisecond)

      joint :left_wheel do
        type :continuous

        sensor :left_encoder,
               {QuadratureEncoder, a: {"gpiochip0", 5}, b: {"gpiochip0", 6}, pulses: 11},
               max_silence: ~u(200 millisecond) do
          transmission do
            reduction 34.0
          end
        end

        link :left_tyre
      end

      joint :right_wheel do
        type :continuous

        sensor :right_encoder,
               {QuadratureEncoder, a: {"gpiochip0", 12}, b: {"gpiochip0", 13}, pulses: 11},
               max_silence: ~u(200 millisecond) do
          transmission do
            reduction 34.0
            reversed? true
          end
        end

        link :right_tyre
      end

      joint :elbow_joint do
        type :revolute

        limit lower: ~u(-180 degree),
              upper: ~u(180 degree),
              effort: ~u(5 newton_meter),
              velocity: ~u(90 degree_per_second)

        sensor :elbow, {As5600, bus: "i2c-2", rate: ~u(100 hertz)},
          max_silence: ~u(200 millisecond)

        link :forearm
      end
    end
  end

  simulation do
    for {bus, devices} <- World.buses() do
      i2c bus do
        for {address, model} <- devices, do: device(address, model)
      end
    end

    gpio World.chip() do
      for {name, model} <- World.lines(), do: device(name, model)
    end
  end
end
