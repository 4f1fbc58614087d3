defmodule BB.Error.Kinematics.UnknownLink do
  @moduledoc """
  A robot has no link of a name. `role` says which link it was to be: `:source` or `:target`.

      iex> error = %BB.Error.Kinematics.UnknownLink{
      ...>   link: :gripper,
      ...>   role: :target,
      ...>   robot: MyRobot
      ...> }
      iex> Exception.message(error)
      "Unknown link: :gripper (the target link) in robot MyRobot"
  """

  use BB.Error, class: :kinematics, fields: [:link, :role, :robot]

  import BB.Error.Text, only: [text: 1]
  alias BB.Error.Text

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e),
    do: "Unknown link: #{inspect(e.link)}#{role(e.role)}#{Text.in_robot(e)}"

  defp role(nil), do: ""
  defp role(role), do: " (the #{text(role)} link)"
end
