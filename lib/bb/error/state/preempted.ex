defmodule BB.Error.State.Preempted do
  @moduledoc """
  An operation ended early, because another one took its place.

      iex> error = %BB.Error.State.Preempted{
      ...>   preempted_operation: :wave,
      ...>   preempting_operation: :stop
      ...> }
      iex> Exception.message(error)
      "operation :wave was preempted by :stop"
  """

  use BB.Error, class: :state, fields: [:preempted_operation, :preempting_operation]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "operation #{inspect(e.preempted_operation)} was preempted by " <>
      "#{inspect(e.preempting_operation)}"
  end
end
