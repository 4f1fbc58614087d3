defmodule BB.PubSub.Retention do
  @moduledoc """
  Keeps the last message of each retained path, and replays it to late subscribers.

  `BB.PubSub.publish/4` keeps messages here; `BB.PubSub.last/2` and `BB.PubSub.subscribe/3` read
  them:

      stamp = Retention.put(bus, path, message)
      Retention.last(bus, path)

  A publisher numbers and keeps its message before it looks up the subscribers. A subscriber is
  known to publishers before it looks up the kept messages. So one of the two always sees the
  message, and when both do, its number shows that (`BB.PubSub.Replay`).

  The number of kept messages on transient paths is bounded (`BB.PubSub.TransientPaths`).
  """

  alias BB.{Message, Path}

  alias BB.PubSub.{
    Admission,
    Bus,
    Cells,
    Replay,
    Subscription,
    Subscriptions,
    SubscriptionState,
    TransientPaths
  }

  @doc """
  Returns the counter that numbers the messages of a retained path.

  Every caller gets the same one.
  """
  @spec sequence(Bus.t(), Path.t()) :: Replay.sequence()
  def sequence(bus, path) do
    new = :atomics.new(1, [])

    case :ets.lookup(bus.last, path) do
      [{_, sequence, _, _}] ->
        sequence

      [] ->
        if :ets.insert_new(bus.last, {path, new, 0, nil}), do: new, else: sequence(bus, path)
    end
  end

  @doc """
  Keeps the message as the last one of its path, which must have a stream. Returns the message's
  stamp.
  """
  @spec put(Bus.t(), Path.t(), Message.t()) :: Replay.stamp()
  def put(bus, path, message) do
    stamp = put(bus, path, message, sequence(bus, path))
    unless TransientPaths.known?(bus, path), do: :ets.delete(bus.last, path)
    stamp
  end

  @doc """
  Keeps the message as `put/3` does, for a permanent path whose sequence the publisher has.
  """
  @spec put(Bus.t(), Path.t(), Message.t(), Replay.sequence()) :: Replay.stamp()
  def put(bus, path, message, sequence) do
    number = :atomics.add_get(sequence, 1, 1)
    :ets.insert(bus.last, {path, sequence, number, message})
    {number, sequence}
  end

  @doc "Returns the last message of the path, or `nil`."
  @spec last(Bus.t(), Path.t()) :: Message.t() | nil
  def last(bus, path) do
    case :ets.lookup(bus.last, path) do
      [{_, _, _, message}] -> message
      [] -> nil
    end
  end

  @doc """
  Sends the kept messages that match the subscription to the calling process.

  The subscription is the caller's, and publishers must know it already.
  """
  @spec replay(Bus.t(), Subscription.t()) :: :ok
  def replay(_bus, %{replay: false}), do: :ok

  def replay(bus, subscription) do
    kept = :ets.select(bus.last, [{{:"$1", :_, :"$2", :_}, [{:>, :"$2", 0}], [:"$1"]}])

    kept
    |> Enum.filter(&Subscription.reaches?(subscription, &1))
    |> Enum.sort()
    |> Enum.each(&replay_path(bus, subscription, &1))

    Replay.finish(subscription.counters)
  end

  # The path may have been forgotten since.
  defp replay_path(bus, subscription, path) do
    cell = Cells.fetch(bus, subscription, path)

    case :ets.lookup(bus.last, path) do
      [{_, _, number, message}] when number > 0 ->
        delivery = {:bb, path, message}

        Replay.run(
          cell,
          number,
          fn -> send_replay(bus, subscription, cell, delivery) end,
          fn -> take_back(subscription, delivery) end
        )

      _ ->
        :ok
    end
  end

  defp send_replay(bus, subscription, cell, {:bb, path, message} = delivery) do
    if Subscription.wants?(subscription, message.payload.__struct__) and
         not replayed_before?(bus, subscription, path) do
      Admission.deliver([Admission.new(subscription, cell)], subscription.pid, delivery, nil)
    end
  end

  defp take_back(subscription, delivery) do
    receive do
      ^delivery -> SubscriptionState.add(subscription.counters, {-1, 1})
    after
      0 -> :ok
    end
  end

  # With `unique`, another subscription of the process may have replayed this message or a newer
  # one.
  defp replayed_before?(bus, subscription, path) do
    Enum.any?(Subscriptions.of(bus, subscription.pid), fn other ->
      other.id != subscription.id and other.replay and
        (other.unique or subscription.unique) and Subscription.reaches?(other, path)
    end)
  end
end
