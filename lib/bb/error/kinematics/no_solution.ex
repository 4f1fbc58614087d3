defmodule BB.Error.Kinematics.NoSolution do
  @moduledoc """
  A solver found no positions of the joints for a pose.

      iex> error = %BB.Error.Kinematics.NoSolution{
      ...>   target_link: :tool,
      ...>   iterations: 100,
      ...>   residual: 0.2
      ...> }
      iex> Exception.message(error)
      "found no solution for link :tool after 100 iterations, residual 0.2"
  """

  use BB.Error,
    class: :kinematics,
    fields: [:target_link, :target_pose, :iterations, :residual, :positions]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "found no solution for link #{inspect(e.target_link)} after " <>
      "#{text(e.iterations)} iterations, residual #{text(e.residual)}"
  end
end
