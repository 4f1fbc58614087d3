defmodule BB.Error.State.StaleEpoch do
  @moduledoc """
  A command was made under an earlier arming of the robot.

      iex> error = %BB.Error.State.StaleEpoch{
      ...>   robot: MyRobot,
      ...>   actuator: :servo,
      ...>   command: :hold,
      ...>   epoch: 3,
      ...>   current_epoch: 5
      ...> }
      iex> Exception.message(error)
      "command :hold of actuator :servo refused: made in arming 3 of MyRobot, current is 5"
  """

  use BB.Error, class: :state, fields: [:robot, :actuator, :command, :epoch, :current_epoch]

  alias BB.Error.Text

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "#{Text.command(e)} refused: made in arming #{inspect(e.epoch)} of #{inspect(e.robot)}, " <>
      "current is #{inspect(e.current_epoch)}"
  end
end
