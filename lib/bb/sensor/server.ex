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

  alias BB.Component

  @doc """
  Starts a sensor's process.

  `args` are `:__callback_module__`, `:bb` (`%{robot: robot_module, path: path}`) and the driver's
  own options. It returns what `GenServer.start_link/3` returns, or
  `{:error, %BB.Options.ValidationError{}}` for options that the driver's schema refuses.
  """
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(args), do: Component.Server.start_link([{:__kind__, BB.Sensor} | args])

  @doc "Returns a child specification whose id contains the sensor's path."
  @spec child_spec(keyword()) :: Supervisor.child_spec()
  def child_spec(args) do
    %{id: {__MODULE__, args[:bb].path}, start: {__MODULE__, :start_link, [args]}}
  end
end
