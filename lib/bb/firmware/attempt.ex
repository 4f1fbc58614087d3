defmodule BB.Firmware.Attempt do
  @moduledoc """
  Runs a function that may raise, exit or never return, within a time limit and with retries.
  Use it for the steps of a board's start, which must continue without a step that fails.

      {:ok, keys} = BB.Firmware.Attempt.run("read the keys", fn -> read_keys() end, attempts: 1)

  A step before ssh must not end the start of a board: a board without ssh accepts no update.
  """

  require Logger

  @attempts 3
  @limit_ms 30_000
  @pause_ms 2_000

  @doc """
  Calls `fun` in a process of its own. Returns `{:ok, result}`, or `:error` when each attempt
  raised, threw, exited or did not return in time. `step` names the step in the log.

  Options: `attempts:` (#{@attempts}), `limit_ms:` for each attempt (#{@limit_ms}), `pause_ms:`
  between two attempts (#{@pause_ms}).
  """
  @spec run(String.t(), (() -> result), keyword()) :: {:ok, result} | :error when result: term()
  def run(step, fun, opts \\ []) do
    opts = Keyword.validate!(opts, attempts: @attempts, limit_ms: @limit_ms, pause_ms: @pause_ms)
    run(step, fun, opts[:attempts], opts)
  end

  defp run(step, fun, attempts, opts) do
    with {:error, reason} <- run_once(fun, opts[:limit_ms]) do
      Logger.error("could not #{step}: #{inspect(reason, limit: 20)}")

      if attempts > 1 do
        Process.sleep(opts[:pause_ms])
        run(step, fun, attempts - 1, opts)
      else
        Logger.error("could not #{step}; the start continues without it")
        :error
      end
    end
  end

  # The exit signal of the process carries the result, so that no late message stays in the
  # mailbox.
  defp run_once(fun, limit_ms) do
    tag = make_ref()
    {pid, ref} = spawn_monitor(fn -> exit({tag, call(fun)}) end)

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

  defp call(fun) do
    {:ok, fun.()}
  rescue
    error -> {:error, Exception.message(error)}
  catch
    kind, reason -> {:error, {kind, reason}}
  end
end
