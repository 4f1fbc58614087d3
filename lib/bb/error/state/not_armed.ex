defmodule BB.Error.State.NotArmed do
  @moduledoc """
  A command of an actuator was refused, because the robot is not armed.

      iex> error = %BB.Error.State.NotArmed{
      ...>   robot: MyRobot,
      ...>   actuator: [:base, :elbow, :servo],
      ...>   command: :position
      ...> }
      iex> Exception.message(error)
      "command :position of actuator [:base, :elbow, :servo] refused: robot is not armed; " <>
        "call BB.Safety.arm(MyRobot) first"
  """

  use BB.Error, class: :state, fields: [:robot, :actuator, :command]

  alias BB.Error.Text

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "#{Text.command(e)} refused: robot is not armed; " <>
      "call BB.Safety.arm(#{inspect(e.robot)}) first"
  end
end
