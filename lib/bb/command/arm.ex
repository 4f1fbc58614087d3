defmodule BB.Command.Arm do
  @moduledoc """
  The handler of a command that arms the robot. Use it unless something has to be done first, such
  as a homing.

      command :arm do
        handler BB.Command.Arm
        allowed_states [:disarmed]
      end

  The command is the robot's arm command (`arm true`) by itself: `BB.Safety.arm/1` executes it.
  Its result is `{:ok, :armed, next_state: state}` with the robot's initial state, or the error of
  `BB.Safety.arm/1`.
  """

  use BB.Command

  alias BB.Dsl.Info
  alias BB.Safety.Controller

  @impl BB.Command
  def handle_command(_goal, %{robot_module: robot}, state) do
    {:stop, :normal,
     %{state | result: Controller.arm(robot), next_state: Info.initial_state(robot)}}
  end

  @impl BB.Command
  def result(%{result: :ok, next_state: next}), do: {:ok, :armed, next_state: next}
  def result(%{result: {:error, reason}}), do: {:error, reason}
  def result(%{result: nil}), do: {:error, :interrupted}
end
