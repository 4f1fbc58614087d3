defmodule BB.Controller do
  @moduledoc """
  The behaviour of a controller: a component without a device, such as a loop that reads sensors
  and commands actuators. A robot's supervisors run it in a process, as they run a sensor
  (`BB.Component.Server`).

  Implement it for a part of the robot's logic that is restarted by itself.

      defmodule MyRobot.Balance do
        use BB.Controller, options_schema: [gain: [type: :float, required: true]]

        @impl BB.Controller
        def init(opts) do
          {:ok, _} = BB.subscribe(opts[:bb].robot, [:sensor, :base_link, :imu])
          {:ok, %{bb: opts[:bb], gain: opts[:gain]}}
        end

        @impl BB.Controller
        def handle_options(opts, state), do: {:ok, %{state | gain: opts[:gain]}}

        @impl BB.Controller
        def handle_info({:bb, _path, message}, state) do
          BB.cast(state.bb.robot, :wheels, {:turn, state.gain * tilt(message.payload)})
          {:noreply, state}
        end
      end

  The robot declares the controller:

      controllers do
        controller :balance, {MyRobot.Balance, gain: param([:balance, :gain])}
      end

  `BB.call/4` calls it by its name, as it calls all components. The sections "Options" and
  "Failures" of `BB.Sensor` apply. Changes of the controller's status are published on
  `[:controller_status | path]`, and its alarm is `{BB.Controller, robot, path}`.
  """

  use BB.Component.Kind, word: :controller

  alias BB.Component.{Health, Reason}

  @doc false
  @impl BB.Component
  def component_options(_joint, _transmission), do: []

  @doc """
  Returns the health of the robot's controllers, as `BB.Sensor.health/1` does of its sensors.
  """
  @spec health(module()) :: [Health.row()]
  def health(robot), do: Health.list(robot, __MODULE__)

  @doc "Formats the reason for which a controller is down, as `BB.Sensor.explain/2` does."
  @spec explain(module(), reason :: term()) :: String.t()
  def explain(module, reason), do: Reason.format(reason, module)
end
