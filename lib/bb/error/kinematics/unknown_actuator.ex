defmodule BB.Error.Kinematics.UnknownActuator do
  @moduledoc """
  A robot has no actuator of a name.

      iex> error = %BB.Error.Kinematics.UnknownActuator{
      ...>   actuator: :pan_servo,
      ...>   robot: MyRobot
      ...> }
      iex> Exception.message(error)
      "Unknown actuator: :pan_servo in robot MyRobot"
  """

  use BB.Error, class: :kinematics, fields: [:actuator, :robot]

  alias BB.Error.Text

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e),
    do: "Unknown actuator: #{inspect(e.actuator)}#{Text.in_robot(e)}"
end
