defmodule BB.Parameter.Store.Worker do
  @moduledoc """
  The process that runs the callbacks of a store. Whatever a callback does becomes a result for
  the caller, within bounded time. `BB.Parameter.Store.Session` uses it.

  A worker is linked to the process that started it. A worker is killed when a callback does not
  return; the store is then opened again in another worker.
  """
  @moduledoc no_example: "internal: BB.Parameter.Store.Session is its interface"

  @type failure :: {:error, reason :: term()} | {:gone, reason :: term()}

  @doc "Starts a worker."
  @spec start_link() :: pid()
  def start_link do
    parent = self()
    spawn_link(fn -> serve(parent) end)
  end

  @doc """
  Runs `fun` in the worker and returns `{:ok, value}`.

  Returns `{:error, reason}` when `fun` raised, threw or exited, and `{:gone, reason}` when the
  worker died, or was killed because `fun` did not return within `timeout_ms`.
  """
  @spec call(pid(), (() -> value), timeout_ms :: pos_integer()) :: {:ok, value} | failure()
        when value: term()
  def call(worker, fun, timeout_ms) do
    ref = Process.monitor(worker)
    send(worker, {:call, self(), ref, fun})

    receive do
      {^ref, result} ->
        Process.demonitor(ref, [:flush])
        result

      {:DOWN, ^ref, :process, _host, reason} ->
        {:gone, {:exit, reason}}
    after
      timeout_ms ->
        kill(worker, ref)
        {:gone, {:timeout, timeout_ms}}
    end
  end

  @doc "Stops a worker that is not busy, and the processes that are linked to it."
  @spec stop(pid()) :: :ok
  def stop(worker) do
    ref = Process.monitor(worker)
    Process.exit(worker, :shutdown)

    # The store's code may have made the worker trap exits.
    receive do
      {:DOWN, ^ref, :process, _host, _reason} -> :ok
    after
      100 -> kill(worker, ref)
    end
  end

  # A late result is in the mailbox when the worker is down.
  defp kill(worker, ref) do
    Process.exit(worker, :kill)

    receive do
      {:DOWN, ^ref, :process, _host, _reason} -> :ok
    end

    receive do
      {^ref, _late} -> :ok
    after
      0 -> :ok
    end
  end

  defp serve(parent) do
    receive do
      {:call, from, ref, fun} ->
        send(from, {ref, attempt(fun)})
        serve(parent)

      # The store has made its process trap exits.
      {:EXIT, ^parent, reason} ->
        exit(reason)

      # The store may send messages to its own process.
      _message ->
        serve(parent)
    end
  end

  defp attempt(fun) do
    {:ok, fun.()}
  rescue
    error -> {:error, error}
  catch
    :throw, value -> {:error, {:thrown, value}}
    :exit, reason -> {:error, {:exit, reason}}
  end
end
