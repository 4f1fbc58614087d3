defmodule BB.Test.Standstill do
  @moduledoc "Measures standstills of the whole VM on a busy machine."

  @period_ms 5

  @doc "Starts to measure."
  def start_link, do: {:ok, spawn_link(fn -> watch(now_ms(), 0) end)}

  @doc "Returns the longest standstill since the last call, in milliseconds."
  def take(pid) do
    send(pid, {:take, self()})

    receive do
      {:standstill, ms} -> ms
    end
  end

  defp watch(since_ms, longest_ms) do
    receive do
      {:take, from} ->
        send(from, {:standstill, longest_ms})
        watch(since_ms, 0)
    after
      @period_ms -> watch(now_ms(), max(longest_ms, now_ms() - since_ms - @period_ms))
    end
  end

  defp now_ms, do: System.monotonic_time(:millisecond)
end
