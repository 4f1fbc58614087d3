defmodule BB.Command.Disarm do
  @moduledoc """
  The handler of a command that disarms the robot. Use it unless something has to be done first,
  such as moving to a place where the robot can rest.

      command :disarm do
        handler BB.Command.Disarm
        allowed_states :*
        cancel :*
      end

  The command is the robot's disarm command (`disarm true`) by itself: `BB.Safety.disarm/2`
  executes it. Its result is `{:ok, :disarmed, next_state: :disarmed}`, or the error of
  `BB.Safety.disarm/2`.
  """

  use BB.Command

  alias BB.Safety.Controller

  @impl BB.Command
  def handle_command(_goal, %{robot_module: robot}, state),
    do: {:stop, :normal, %{state | result: Controller.disarm(robot), next_state: :disarmed}}

  @impl BB.Command
  def handle_safety_state_change(_state, state), do: {:continue, state}

  @impl BB.Command
  def result(%{result: :ok, next_state: next}), do: {:ok, :disarmed, next_state: next}
  def result(%{result: {:error, reason}}), do: {:error, reason}
  def result(%{result: nil}), do: {:error, :interrupted}
end
