defmodule BB.Error.Kinematics.UnknownJoint do
  @moduledoc """
  A robot has no joint of a name.

      iex> error = %BB.Error.Kinematics.UnknownJoint{
      ...>   joint: :not_a_real_joint,
      ...>   robot: MyRobot
      ...> }
      iex> Exception.message(error)
      "Unknown joint: :not_a_real_joint in robot MyRobot"
  """

  use BB.Error, class: :kinematics, fields: [:joint, :robot]

  alias BB.Error.Text

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e), do: "Unknown joint: #{inspect(e.joint)}#{Text.in_robot(e)}"
end
