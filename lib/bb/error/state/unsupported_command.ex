defmodule BB.Error.State.UnsupportedCommand do
  @moduledoc """
  An actuator does not support a command.

      iex> error = %BB.Error.State.UnsupportedCommand{
      ...>   robot: MyRobot,
      ...>   actuator: :servo,
      ...>   command: :effort,
      ...>   supported: [:position]
      ...> }
      iex> Exception.message(error)
      "command :effort of actuator :servo refused: the actuator of MyRobot supports [:position]"
  """

  use BB.Error, class: :state, fields: [:robot, :actuator, :command, :supported]

  alias BB.Error.Text

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "#{Text.command(e)} refused: the actuator of " <>
      "#{inspect(e.robot)} supports #{inspect(e.supported)}"
  end
end
