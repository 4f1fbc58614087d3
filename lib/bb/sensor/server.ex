defmodule BB.Sensor.Server do
  @moduledoc """
  The process of a sensor: `BB.Component.Server` for modules that implement `BB.Sensor`.

  A robot's supervisors start the sensors of the robot. Use this module to start one in a driver's
  test:

      start_supervised!(
        {BB.Sensor.Server,
         __callback_module__: MyDriver,
         bb: %{robot: MyRobot, path: [:base_link, :imu]},
         bus: "i2c-1"}
      )
  """

  use BB.Component.Kind.Server, kind: BB.Sensor
end
