defmodule Ganglion.Demo.Processor do
  @moduledoc """
  How much of one processor core this VM uses, with all that runs in it.
  """

  @opaque t :: {cpu_ms :: integer(), time_ms :: integer()}

  @doc "Begins to measure."
  @spec start() :: t()
  def start, do: {cpu_ms(), now_ms()}

  @doc "The share of one core since then: 1.0 is a whole one. `nil` before a second has passed."
  @spec share(t()) :: float() | nil
  def share({cpu_ms, time_ms}) do
    passed_ms = now_ms() - time_ms
    if passed_ms >= 1000, do: (cpu_ms() - cpu_ms) / passed_ms
  end

  # Of all threads of the VM.
  defp cpu_ms, do: :runtime |> :erlang.statistics() |> elem(0)
  defp now_ms, do: System.monotonic_time(:millisecond)
end
