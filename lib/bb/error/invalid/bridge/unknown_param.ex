defmodule BB.Error.Invalid.Bridge.UnknownParam do
  @moduledoc """
  A bridge has no remote parameter of a name.

      iex> error = %BB.Error.Invalid.Bridge.UnknownParam{
      ...>   param_name: :speed,
      ...>   control_table: STS3215
      ...> }
      iex> Exception.message(error)
      "unknown remote parameter :speed: not found in control table STS3215"
      iex> Exception.message(%BB.Error.Invalid.Bridge.UnknownParam{param_name: :speed})
      "unknown remote parameter :speed"
  """

  use BB.Error, class: :invalid, fields: [:param_name, :control_table]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e),
    do: "unknown remote parameter #{inspect(e.param_name)}#{place(e.control_table)}"

  defp place(nil), do: ""
  defp place(table), do: ": not found in control table #{inspect(table)}"
end
