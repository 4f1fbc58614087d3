defmodule BB.Actuator do
  @moduledoc """
  The behaviour of an actuator's driver. A robot's supervisors run the driver in a process, as
  they run a sensor (`BB.Component.Server`).

  Implement it for hardware that moves a joint.

      defmodule MyRobot.Servo do
        use BB.Actuator, options_schema: [channel: [type: :integer, required: true]]

        @impl BB.Actuator
        def init(opts), do: open(opts[:channel])

        @impl BB.Actuator
        def disarm(opts), do: stop(opts[:channel])

        @impl BB.Actuator
        def handle_call({:turn_to, joint}, _from, state) do
          {:reply, set(state, BB.Transmission.apply_position(joint, state.transmission)), state}
        end
      end

  A joint of the robot declares the actuator:

      actuator :servo, {MyRobot.Servo, channel: 0} do
        transmission reduction: 3.0
      end

  `BB.call(MyRobot, :servo, {:turn_to, 0.5})` calls it by its name, and so do `BB.cast/3` and
  `BB.send/3`.

  `init/1` receives the driver's options, `opts[:bb]` and `opts[:actuator_profile]`
  (`BB.Actuator.ActuatorProfile`). Options and transmission may refer to parameters. The sections
  "Options" and "Failures" of `BB.Sensor` apply. Changes of the actuator's status are published on
  `[:actuator_status | path]`, and its alarm is `{BB.Actuator, robot, path}`.
  """

  use BB.Component.Kind, word: :actuator

  alias BB.Actuator.ActuatorProfile
  alias BB.Component.{Health, Reason}

  @doc false
  @impl BB.Component
  def component_options(joint_name, transmission),
    do: [actuator_profile: %ActuatorProfile{joint_name: joint_name, transmission: transmission}]

  @doc "Returns the health of the robot's actuators, as `BB.Sensor.health/1` does of its sensors."
  @spec health(module()) :: [Health.row()]
  def health(robot), do: Health.list(robot, __MODULE__)

  @doc "Formats the reason for which an actuator is down, as `BB.Sensor.explain/2` does."
  @spec explain(module(), reason :: term()) :: String.t()
  def explain(module, reason), do: Reason.format(reason, module)
end
