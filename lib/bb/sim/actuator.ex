defmodule BB.Sim.Actuator do
  @moduledoc """
  The actuator that stands for every actuator of a simulated robot.

  A robot that is started with `simulation:` uses it in place of its drivers:

      {:ok, _} = MyRobot.start_link(simulation: :kinematic)
      :ok = BB.Safety.arm(MyRobot)
      :ok = BB.Actuator.set_position(MyRobot, :servo, 0.5)

  A position command moves it, within the limits of the joint. It announces the motion by a
  `BB.Message.Actuator.BeginMotion` with the course that the limits of velocity and acceleration
  allow, from where it is at that moment. It accepts all other commands and does nothing for them.
  Without a limit of the velocity it is at its target at once.
  """

  use BB.Actuator

  alias BB.Actuator
  alias BB.Message
  alias BB.Message.Actuator.Command.Position
  alias BB.Sim.Motion

  @impl BB.Actuator
  def init(opts) do
    profile = opts[:motor_profile]
    motion = Motion.at(profile.motor_initial_position, now_ms())
    {:ok, %{bb: opts[:bb], profile: profile, motion: motion}}
  end

  @impl BB.Actuator
  def disarm(_opts), do: :ok

  @impl BB.Actuator
  def handle_options(opts, state), do: {:ok, %{state | profile: opts[:motor_profile]}}

  @impl BB.Actuator
  def handle_command(%Message{payload: %Position{} = command}, state) do
    now_ms = now_ms()
    from = Motion.position(state.motion, now_ms)
    motion = Motion.plan(from, command.position, state.profile, now_ms)
    announce(state.bb, motion, command)
    {:noreply, %{state | motion: motion}}
  end

  def handle_command(_other_command, state), do: {:noreply, state}

  defp announce(%{robot: robot, path: path}, motion, command) do
    Actuator.publish_begin_motion(robot, path,
      initial_position: motion.from,
      target_position: motion.to,
      expected_arrival: motion.begin_ms + motion.duration_ms,
      command_id: command.command_id,
      command_type: :position,
      acceleration: motion.acceleration,
      peak_velocity: motion.peak_velocity
    )
  end

  defp now_ms, do: System.monotonic_time(:millisecond)
end
