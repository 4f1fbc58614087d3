defmodule BB.Error.Invalid.Bridge.TorqueMustBeDisabled do
  @moduledoc """
  A remote parameter can be written only while the torque is off.

      iex> error = %BB.Error.Invalid.Bridge.TorqueMustBeDisabled{
      ...>   param_name: :id,
      ...>   servo_id: 3
      ...> }
      iex> Exception.message(error)
      "cannot write :id of servo 3 while its torque is on; disable the torque first"
  """

  use BB.Error, class: :invalid, fields: [:param_name, :servo_id]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "cannot write #{inspect(e.param_name)}#{owner(e.servo_id)} while its torque is on; " <>
      "disable the torque first"
  end

  defp owner(nil), do: ""
  defp owner(id), do: " of servo #{text(id)}"
end
