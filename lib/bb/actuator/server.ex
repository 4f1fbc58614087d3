defmodule BB.Actuator.Server do
  @moduledoc """
  The process of an actuator: `BB.Component.Server` for modules that implement `BB.Actuator`.

  A robot's supervisors start the actuators of the robot. Use this module to start one in a
  driver's test:

      start_supervised!(
        {BB.Actuator.Server,
         __callback_module__: MyServo,
         bb: %{robot: MyRobot, path: [:base_link, :shoulder, :servo]},
         channel: 0}
      )
  """

  use BB.Component.Kind.Server, kind: BB.Actuator
end
