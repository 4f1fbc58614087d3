defmodule BB.Test.Eventually do
  @moduledoc "Waits for a condition that sends no message."

  @doc """
  Calls `fun` repeatedly until it returns a true value, and returns that value. Fails after
  `timeout_ms`.
  """
  def eventually(fun, timeout_ms \\ 60_000),
    do: eventually(fun, timeout_ms, System.monotonic_time(:millisecond))

  defp eventually(fun, timeout_ms, started) do
    cond do
      result = fun.() ->
        result

      System.monotonic_time(:millisecond) - started > timeout_ms ->
        raise ExUnit.AssertionError, "not within #{timeout_ms} ms"

      true ->
        Process.sleep(5)
        eventually(fun, timeout_ms, started)
    end
  end
end
