defmodule BB.Error.Kinematics.MultiFailed do
  @moduledoc """
  One of several targets could not be solved. `partial_results` has the result of each link that
  was tried.

      iex> error = %BB.Error.Kinematics.MultiFailed{
      ...>   failed_link: :right,
      ...>   error: :no_solution,
      ...>   partial_results: %{left: {:ok, %{}, %{}}}
      ...> }
      iex> Exception.message(error)
      "could not solve link :right: no_solution; 1 target(s) solved before failure"
  """

  use BB.Error, class: :kinematics, fields: [:failed_link, :error, :partial_results]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "could not solve link #{inspect(e.failed_link)}: #{text(e.error)}; " <>
      "#{solved(e.partial_results)} target(s) solved before failure"
  end

  defp solved(results) when is_map(results) or is_list(results),
    do: Enum.count(results, &solved?/1)

  defp solved(_none), do: 0

  defp solved?({:ok, _positions, _meta}), do: true
  defp solved?({_link, {:ok, _positions, _meta}}), do: true
  defp solved?(_failed), do: false
end
