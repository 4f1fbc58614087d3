defmodule BB.Error.Invalid.Bridge.ReadOnly do
  @moduledoc """
  A remote parameter cannot be written.

      iex> Exception.message(%BB.Error.Invalid.Bridge.ReadOnly{param_name: :present_position})
      "remote parameter :present_position is read-only"
  """

  use BB.Error, class: :invalid, fields: [:param_name]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e), do: "remote parameter #{inspect(e.param_name)} is read-only"
end
