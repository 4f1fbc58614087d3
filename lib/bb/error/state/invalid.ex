defmodule BB.Error.State.Invalid do
  @moduledoc """
  A state does not exist.

      iex> error = %BB.Error.State.Invalid{
      ...>   state: :flying,
      ...>   valid_states: [:idle, :driving]
      ...> }
      iex> Exception.message(error)
      "expected a state of [:idle, :driving], got: :flying"
  """

  use BB.Error, class: :invalid, fields: [:state, :valid_states]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e),
    do: "expected a state of #{inspect(e.valid_states)}, got: #{inspect(e.state)}"
end
