defmodule BB.Parameter.Store.Worker do
  @moduledoc """
  The process in which a store's callbacks run, and the one place that calls them. Whatever a
  callback does is a result for the caller, within bounded time.

  A worker is linked to the process that started it. One that has been killed, for a callback that
  did not return, is of no further use; the store is opened anew in another.
  """

  @type failure :: {:error, reason :: term()} | {:gone, reason :: term()}

  @doc "Starts a worker."
  @spec start_link() :: pid()
  def start_link do
    parent = self()
    spawn_link(fn -> serve(parent) end)
  end

  @doc """
  What `fun` returns, run by the worker: `{:ok, value}`. `{:error, reason}` when it raised, threw or
  exited. `{:gone, reason}` when the worker died of it, or was killed since there was no answer
  within `timeout_ms`.
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

  @doc "Ends a worker that is not busy, and with it what is linked to it."
  @spec stop(pid()) :: :ok
  def stop(worker) do
    ref = Process.monitor(worker)
    Process.exit(worker, :shutdown)

    # Unless it or the store's own code traps exits.
    receive do
      {:DOWN, ^ref, :process, _host, _reason} -> :ok
    after
      100 -> kill(worker, ref)
    end
  end

  # An answer that comes at the last moment is in the mailbox when the worker is down.
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

      # For a store that makes its process trap exits.
      {:EXIT, ^parent, reason} ->
        exit(reason)

      # A store's own process may get what it likes.
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
