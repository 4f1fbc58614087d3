defmodule BB.Error.Invalid.Bridge.InvalidParamId do
  @moduledoc """
  The id of a remote parameter does not have the form of its bridge.

      iex> Exception.message(%BB.Error.Invalid.Bridge.InvalidParamId{param_id: "torque"})
      ~s(remote parameter "torque" is invalid, expected an id as "servo_id:param_name")
  """

  use BB.Error, class: :invalid, fields: [:param_id]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "remote parameter #{inspect(e.param_id)} is invalid, expected an id as " <>
      inspect("servo_id:param_name")
  end
end
