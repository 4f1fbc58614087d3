defmodule BB.Sensor.Server do
  @moduledoc """
  The process of a sensor: `BB.Component.Server` for modules that implement `BB.Sensor`.

  A robot's supervisors start it. A test of a driver can do so too:

      start_supervised!(
        {BB.Sensor.Server,
         __callback_module__: MyDriver, bb: %{robot: MyRobot, path: [:base_link, :imu]}, bus: "i2c-1"}
      )
  """

  alias BB.Component

  @doc """
  Starts a sensor: its callback module as `:__callback_module__`, `:bb` (`%{robot: R, path: path}`), and its own options.

  Returns what `GenServer.start_link/3` returns; options that its schema refuses give
  `{:error, %BB.Options.ValidationError{}}`.
  """
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(args), do: Component.Server.start_link([{:__kind__, BB.Sensor} | args])

  @doc "A permanent place under a supervisor, its id the sensor's path."
  @spec child_spec(keyword()) :: Supervisor.child_spec()
  def child_spec(args) do
    %{id: {__MODULE__, args[:bb].path}, start: {__MODULE__, :start_link, [args]}}
  end
end
