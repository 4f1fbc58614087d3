defmodule BB.Error.Safety.DisarmFailed do
  @moduledoc """
  A component could not be disarmed.

      iex> error = %BB.Error.Safety.DisarmFailed{
      ...>   component_path: [:base, :servo],
      ...>   reason: :bus_stuck
      ...> }
      iex> Exception.message(error)
      "could not disarm component [:base, :servo]: bus_stuck"
  """

  use BB.Error, class: :safety, fields: [:component_path, :reason, :failures]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :critical
  end

  @impl Exception
  def message(%__MODULE__{} = e),
    do: "could not disarm component #{inspect(e.component_path)}: #{text(e.reason || e.failures)}"
end
