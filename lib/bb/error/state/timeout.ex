defmodule BB.Error.State.Timeout do
  @moduledoc """
  A change of state took too long.

      iex> error = %BB.Error.State.Timeout{
      ...>   from_state: :idle,
      ...>   to_state: :driving,
      ...>   timeout_ms: 500
      ...> }
      iex> Exception.message(error)
      "change from state :idle to :driving did not end within 500 ms"
  """

  use BB.Error, class: :state, fields: [:from_state, :to_state, :timeout_ms]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "change from state #{inspect(e.from_state)} to #{inspect(e.to_state)} did not end within " <>
      "#{text(e.timeout_ms)} ms"
  end
end
