defmodule BB.Error.Estimator.StaleInput do
  @moduledoc """
  An input of an estimator is older than its budget.

      iex> error = %BB.Error.Estimator.StaleInput{
      ...>   input_path: [:sensor, :imu],
      ...>   age_ms: 120,
      ...>   budget_ms: 50
      ...> }
      iex> Exception.message(error)
      "input [:sensor, :imu] is 120 ms old, expected at most 50 ms"
  """

  use BB.Error, class: :state, fields: [:input_path, :age_ms, :budget_ms]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :warning
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "input #{inspect(e.input_path)} is #{text(e.age_ms)} ms old, expected at most " <>
      "#{text(e.budget_ms)} ms"
  end
end
