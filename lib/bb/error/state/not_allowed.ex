defmodule BB.Error.State.NotAllowed do
  @moduledoc """
  An operation is not allowed in the current state of the robot.

      iex> error = %BB.Error.State.NotAllowed{
      ...>   operation: :wave,
      ...>   current_state: :disarmed,
      ...>   allowed_states: [:idle]
      ...> }
      iex> Exception.message(error)
      "operation :wave is not allowed in state :disarmed, allowed in: [:idle]"
  """

  use BB.Error, class: :state, fields: [:operation, :current_state, :allowed_states]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "operation #{inspect(e.operation)} is not allowed in state #{inspect(e.current_state)}, " <>
      "allowed in: #{inspect(e.allowed_states)}"
  end
end
