defmodule BB.Error.Estimator.MissingCovariance do
  @moduledoc """
  A message has no covariance, and an estimator needs it.

      iex> error = %BB.Error.Estimator.MissingCovariance{
      ...>   estimator: :pose,
      ...>   field: :orientation_covariance
      ...> }
      iex> Exception.message(error)
      "estimator :pose needs the covariance :orientation_covariance, and the message has none"
  """

  use BB.Error, class: :invalid, fields: [:estimator, :field]

  defimpl BB.Error.Severity do
    def severity(_error), do: :error
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "estimator #{inspect(e.estimator)} needs the covariance #{inspect(e.field)}, " <>
      "and the message has none"
  end
end
