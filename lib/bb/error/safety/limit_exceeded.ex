defmodule BB.Error.Safety.LimitExceeded do
  @moduledoc """
  A component exceeded a limit.

      iex> error = %BB.Error.Safety.LimitExceeded{
      ...>   component_path: [:base, :motor],
      ...>   limit_type: :current,
      ...>   measured_value: 5.2,
      ...>   limit_value: 4,
      ...>   unit: :ampere
      ...> }
      iex> Exception.message(error)
      "component [:base, :motor] exceeded its limit of current: 5.2 ampere, limit 4 ampere"
  """

  use BB.Error,
    class: :safety,
    fields: [:component_path, :limit_type, :measured_value, :limit_value, :unit]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :critical
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "component #{inspect(e.component_path)} exceeded its limit of #{text(e.limit_type)}: " <>
      "#{text(e.measured_value)}#{unit(e)}, limit #{text(e.limit_value)}#{unit(e)}"
  end

  defp unit(%{unit: nil}), do: ""
  defp unit(%{unit: unit}), do: " #{text(unit)}"
end
