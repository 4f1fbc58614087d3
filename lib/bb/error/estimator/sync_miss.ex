defmodule BB.Error.Estimator.SyncMiss do
  @moduledoc """
  Two inputs of an estimator are too far apart in time to be combined.

      iex> error = %BB.Error.Estimator.SyncMiss{
      ...>   driver_path: [:sensor, :imu],
      ...>   input_path: [:sensor, :gps],
      ...>   gap_ms: 80,
      ...>   tolerance_ms: 10
      ...> }
      iex> Exception.message(error)
      "input [:sensor, :gps] is 80 ms apart from [:sensor, :imu], expected at most 10 ms"
  """

  use BB.Error, class: :state, fields: [:driver_path, :input_path, :gap_ms, :tolerance_ms]

  import BB.Error.Text, only: [text: 1]

  defimpl BB.Error.Severity do
    def severity(_error), do: :warning
  end

  @impl Exception
  def message(%__MODULE__{} = e) do
    "input #{inspect(e.input_path)} is #{text(e.gap_ms)} ms apart from " <>
      "#{inspect(e.driver_path)}, expected at most #{text(e.tolerance_ms)} ms"
  end
end
