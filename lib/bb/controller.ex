defmodule BB.Controller do
  @moduledoc """
  What belongs to no device and yet is part of the robot: a loop that reads sensors and tells actuators. A module with
  callbacks, which a robot's supervisors run in the same process as a sensor's (`BB.Component.Server`), under the same keeper.

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

  and in the robot:

      controllers do
        controller :balance, {MyRobot.Balance, gain: param([:balance, :gain])}
      end

  It is reached by its name, as all components are (`BB.call/4`). All that `BB.Sensor` says of options and of what goes wrong
  holds here; a change of its state is published on `[:controller_status | path]`, its alarm is `{BB.Controller, robot, path}`.
  """

  use BB.Component.Kind, word: :controller

  alias BB.Component.{Health, Reason}

  @doc false
  @impl BB.Component
  def component_options(_joint_name, _transmission), do: []

  @doc "How each of the robot's controllers fares, as `BB.Sensor.health/1` tells of sensors."
  @spec health(module()) :: [Health.row()]
  def health(robot), do: Health.list(robot, __MODULE__)

  @doc "Why a controller is down, for a person, as `BB.Sensor.explain/2` tells of sensors."
  @spec explain(module(), reason :: term()) :: String.t()
  def explain(module, reason), do: Reason.format(reason, module)
end
