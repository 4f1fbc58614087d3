defmodule Ganglion.Robots.All do
  @moduledoc """
  A robot with every driver that ships: twelve devices on two I2C buses, a chip of GPIO lines and the processor itself. `bin/demo --robot all` runs it, `bin/chaos sensors` breaks it.

  | sensor | what | where | declared |
  |---|---|---|---|
  | `:imu` | MPU-6050 | `i2c-1`, 0x68 | 100 Hz |
  | `:battery` | INA219 | `i2c-1`, 0x40 | 10 Hz |
  | `:motors` | INA219 | `i2c-2`, 0x41 | 10 Hz |

  What they are wired to is `Ganglion.Robots.All.World`.
  """

  use BB

  alias BB.Sensor.{Ina219, Mpu6050}

  settings do
    name(:all)
  end

  topology do
    link :base_link do
      sensor(:imu, {Mpu6050, bus: "i2c-1", rate: ~u(100 hertz)}, max_silence: ~u(200 millisecond))

      sensor(:battery, {Ina219, bus: "i2c-1", rate: ~u(10 hertz)},
        max_silence: ~u(500 millisecond)
      )

      sensor(:motors, {Ina219, bus: "i2c-2", address: 0x41, rate: ~u(10 hertz)},
        max_silence: ~u(500 millisecond)
      )
    end
  end
end
