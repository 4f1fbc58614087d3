defmodule BB.Test.Actor do
  @moduledoc """
  A process that runs functions on request, and keeps its messages until a test reads them.
  """

  @doc "Starts an actor that ends with the calling process."
  def start do
    caller = self()

    spawn(fn ->
      ref = Process.monitor(caller)
      act(caller, ref)
    end)
  end

  @doc "Runs `fun` in the actor and returns its result."
  def run(actor, fun) do
    ref = Process.monitor(actor)
    send(actor, {__MODULE__, ref, self(), fun})

    receive do
      {^ref, result} ->
        Process.demonitor(ref, [:flush])
        result

      {:DOWN, ^ref, _, _, reason} ->
        exit(reason)
    end
  end

  @doc """
  Returns the messages since the last call, oldest first: `{path, payload}`, and `{:missed, path,
  count}`.
  """
  def received(actor), do: run(actor, fn -> take([]) end)

  @doc "Returns the number of messages in its mailbox."
  def waiting(actor),
    do: run(actor, fn -> Process.info(self(), :message_queue_len) |> elem(1) end)

  @doc "Kills the actor, and returns when it has ended."
  def stop(actor) do
    ref = Process.monitor(actor)
    Process.exit(actor, :kill)

    receive do
      {:DOWN, ^ref, _, _, _} -> :ok
    end
  end

  defp act(caller, ref) do
    receive do
      {__MODULE__, reply, from, fun} ->
        send(from, {reply, fun.()})
        act(caller, ref)

      {:DOWN, ^ref, _, _, _} ->
        :ok
    end
  end

  defp take(taken) do
    receive do
      {:bb, path, message} -> take([{path, message.payload} | taken])
      {:bb_missed, path, count} -> take([{:missed, path, count} | taken])
    after
      0 -> Enum.reverse(taken)
    end
  end
end
