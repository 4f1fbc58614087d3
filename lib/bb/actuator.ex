defmodule BB.Actuator do
  @moduledoc """
  An actuator's driver: a module with callbacks, which a robot's supervisors run in the same process as a sensor's
  (`BB.Component.Server`), under the same keeper.

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

  and in a joint of the robot:

      actuator :servo, {MyRobot.Servo, channel: 0} do
        transmission reduction: 3.0
      end

  It is reached by its name: `BB.call(MyRobot, :servo, {:turn_to, 0.5})`, and likewise `BB.cast/3` and `BB.send/3`.

  Beside its own options `init/1` gets `opts[:bb]` and `opts[:actuator_profile]` (`BB.Actuator.ActuatorProfile`). Options and
  transmission may follow parameters. All that `BB.Sensor` says of options and of what goes wrong holds here; a change of its
  state is published on `[:actuator_status | path]`, its alarm is `{BB.Actuator, robot, path}`.
  """

  use BB.Component.Kind, word: :actuator

  alias BB.Actuator.ActuatorProfile
  alias BB.Component.{Health, Reason}

  @doc false
  @impl BB.Component
  def component_options(joint_name, transmission),
    do: [actuator_profile: %ActuatorProfile{joint_name: joint_name, transmission: transmission}]

  @doc "How each of the robot's actuators fares, as `BB.Sensor.health/1` tells of sensors."
  @spec health(module()) :: [Health.row()]
  def health(robot), do: Health.list(robot, __MODULE__)

  @doc "Why an actuator is down, for a person, as `BB.Sensor.explain/2` tells of sensors."
  @spec explain(module(), reason :: term()) :: String.t()
  def explain(module, reason), do: Reason.format(reason, module)
end
