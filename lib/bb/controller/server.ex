defmodule BB.Controller.Server do
  @moduledoc """
  The process of a controller: `BB.Component.Server` for modules that implement `BB.Controller`.

  A robot's supervisors start the controllers of the robot. Use this module to start one in a
  test:

      start_supervised!(
        {BB.Controller.Server,
         __callback_module__: MyBalance, bb: %{robot: MyRobot, path: [:balance]}, gain: 2.0}
      )
  """

  use BB.Component.Kind.Server, kind: BB.Controller
end
