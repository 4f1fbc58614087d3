defmodule BB.Firmware.Attempt do
  @moduledoc """
  Does what may raise, exit or never return, in a start that has to go on without it.

  What comes before ssh in a board's start must not end it: a board that nobody can reach takes no
  update either. So each such step runs in a process of its own, for a limited time, is tried
  again, and is given up in the end with a line in the log.
  """

  require Logger

  @attempts 3
  @limit_ms 30_000
  @pause_ms 2_000

  @doc """
  Calls `fun`, and returns `{:ok, result}`, or `:error` when it raised, threw, exited or did not
  return in time, each time.

  Options: `attempts:` (#{@attempts}), `limit_ms:` for each of them (#{@limit_ms}), `pause_ms:`
  between two (#{@pause_ms}).
  """
  @spec run(String.t(), (() -> result), keyword()) :: {:ok, result} | :error when result: term()
  def run(what, fun, opts \\ []) do
    opts = Keyword.validate!(opts, attempts: @attempts, limit_ms: @limit_ms, pause_ms: @pause_ms)
    run(what, fun, opts[:attempts], opts)
  end

  defp run(what, fun, attempts, opts) do
    with {:error, reason} <- once(fun, opts[:limit_ms]) do
      Logger.error("#{what}: #{inspect(reason, limit: 20)}")

      if attempts > 1 do
        Process.sleep(opts[:pause_ms])
        run(what, fun, attempts - 1, opts)
      else
        Logger.error("#{what}: the start goes on without it")
        :error
      end
    end
  end

  # The exit signal of the process carries the result, so that no message is left behind.
  defp once(fun, limit_ms) do
    tag = make_ref()
    {pid, ref} = spawn_monitor(fn -> exit({tag, result(fun)}) end)

    receive do
      {:DOWN, ^ref, :process, ^pid, {^tag, result}} -> result
      {:DOWN, ^ref, :process, ^pid, reason} -> {:error, reason}
    after
      limit_ms ->
        Process.demonitor(ref, [:flush])
        Process.exit(pid, :kill)
        {:error, {:no_return_within_ms, limit_ms}}
    end
  end

  defp result(fun) do
    {:ok, fun.()}
  rescue
    error -> {:error, Exception.message(error)}
  catch
    kind, reason -> {:error, {kind, reason}}
  end
end
