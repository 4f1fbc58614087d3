defmodule BB.PubSub.Retention do
  @moduledoc """
  The last messages of retained paths, and their replay to late subscribers.

  A publisher numbers and keeps its message before it looks who is subscribed; a subscriber is
  known to publishers before it looks what is kept. So whatever the moment, a message is seen by
  one of the two, and the numbers tell when it was seen by both (`BB.PubSub.Gate`).

  What is kept of passing paths is bounded, `BB.PubSub.Passing` says how.
  """

  alias BB.{Message, Path}
  alias BB.PubSub.{Bus, Gate, Pages, Passing, Subscription}

  @type sequence :: :atomics.atomics_ref()

  @doc "The source of a retained path's numbers, the same one for all who ask."
  @spec sequence(Bus.t(), Path.t()) :: sequence()
  def sequence(bus, path) do
    fresh = :atomics.new(1, [])

    case :ets.lookup(bus.last, path) do
      [{_, sequence, _, _}] ->
        sequence

      [] ->
        if :ets.insert_new(bus.last, {path, fresh, 0, nil}), do: fresh, else: sequence(bus, path)
    end
  end

  @doc """
  Keeps the message as the last one of its path, which `BB.PubSub.Traffic` knows. Returns its
  number.
  """
  @spec keep(Bus.t(), Path.t(), Message.t()) :: Gate.stamp()
  def keep(bus, path, message) do
    number = keep(bus, path, message, sequence(bus, path))
    unless Passing.known?(bus, path), do: :ets.delete(bus.last, path)
    number
  end

  @doc "The same, for a publisher who knows the sequence, of a path that lasts."
  @spec keep(Bus.t(), Path.t(), Message.t(), sequence()) :: Gate.stamp()
  def keep(bus, path, message, sequence) do
    number = :atomics.add_get(sequence, 1, 1)
    :ets.insert(bus.last, {path, sequence, number, message})
    {number, sequence}
  end

  @doc "The last message of the path, or `nil`."
  @spec last(Bus.t(), Path.t()) :: Message.t() | nil
  def last(bus, path) do
    case :ets.lookup(bus.last, path) do
      [{_, _, _, message}] -> message
      [] -> nil
    end
  end

  @doc "Sends the last messages to the calling process, whose subscription this is and is known to publishers."
  @spec replay(Bus.t(), Subscription.t()) :: :ok
  def replay(_bus, %{replay: false}), do: :ok

  def replay(bus, subscription) do
    kept = :ets.select(bus.last, [{{:"$1", :_, :"$2", :_}, [{:>, :"$2", 0}], [:"$1"]}])

    kept
    |> Enum.filter(&Subscription.reaches?(subscription, &1))
    |> Enum.sort()
    |> Enum.each(&replay(bus, subscription, &1))

    Gate.replayed_all(subscription.counters)
  end

  # The path may have been forgotten meanwhile.
  defp replay(bus, subscription, path) do
    cell = Gate.cell(bus, subscription, path)

    case :ets.lookup(bus.last, path) do
      [{_, _, number, message}] when number > 0 ->
        delivery = {:bb, path, message}

        Gate.replay(
          cell,
          number,
          fn -> replay(bus, subscription, path, delivery) end,
          fn -> take_back(subscription, delivery) end
        )

      _ ->
        :ok
    end
  end

  defp replay(bus, subscription, path, {:bb, path, message} = delivery) do
    if Subscription.wants?(subscription, message.payload.__struct__) and
         not replayed_before?(bus, subscription, path) do
      gate = Gate.new(bus, subscription, path, true)
      Gate.deliver([gate], subscription.pid, delivery, nil)
    end
  end

  defp take_back(subscription, delivery) do
    receive do
      ^delivery -> Gate.correct(subscription.counters, {-1, 1})
    after
      0 -> :ok
    end
  end

  # One copy: another subscription of the process has had it, or what is newer.
  defp replayed_before?(bus, subscription, path) do
    Enum.any?(Pages.of(bus, subscription.pid), fn other ->
      other.id != subscription.id and other.replay and
        (other.unique or subscription.unique) and Subscription.reaches?(other, path)
    end)
  end
end
