defmodule BB.Sensor.Conformance.Failure do
  @moduledoc "A driver does not do what every driver does; the message says what was seen instead."
  defexception [:message]

  @doc "Raises it unless `kept?`."
  @spec unless_kept(boolean(), String.t()) :: :ok
  def unless_kept(true, _sentence), do: :ok
  def unless_kept(false, sentence), do: raise(__MODULE__, sentence)
end
