defmodule BB.PubSub.Retention do
  @moduledoc """
  The last messages of retained paths, and their replay to late subscribers.

  A publisher numbers and keeps its message before it looks who is subscribed; a subscriber is known to publishers before it
  looks what is kept. So whatever the moment, a message is seen by one of the two, and the numbers tell when it was seen by
  both (`BB.PubSub.Gate`).
  """

  alias BB.{Message, Path}
  alias BB.PubSub.{Bus, Gate, Subscription}

  @type sequence :: :atomics.atomics_ref()

  @doc "The source of a retained path's numbers, the same one for all who ask."
  @spec sequence(Bus.t(), Path.t()) :: sequence()
  def sequence(bus, path) do
    _ = :ets.insert_new(bus.last, {path, :atomics.new(1, []), 0, nil})
    :ets.lookup_element(bus.last, path, 2)
  end

  @doc "Keeps the message as the last one of its path. Returns its number."
  @spec keep(Bus.t(), Path.t(), Message.t()) :: pos_integer()
  def keep(bus, path, message), do: keep(bus, path, message, sequence(bus, path))

  @doc "The same, for a publisher who knows the sequence."
  @spec keep(Bus.t(), Path.t(), Message.t(), sequence()) :: pos_integer()
  def keep(bus, path, message, sequence) do
    number = :atomics.add_get(sequence, 1, 1)
    :ets.insert(bus.last, {path, sequence, number, message})
    number
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
  end

  defp replay(bus, subscription, path) do
    Gate.replay(Gate.cell(bus, subscription, path), fn ->
      [{_, _, number, message}] = :ets.lookup(bus.last, path)

      if Subscription.wants?(subscription, message.payload.__struct__) and
           not replayed_before?(bus, subscription, path) do
        gate = Gate.new(bus, subscription, path, true)
        Gate.deliver([gate], subscription.pid, {:bb, path, message}, nil)
      end

      number
    end)
  end

  # One copy: another subscription of the process has had it, or what is newer.
  defp replayed_before?(bus, subscription, path) do
    Enum.any?(Bus.above(bus, path), fn other ->
      other.pid == subscription.pid and other.id != subscription.id and other.replay and
        (other.unique or subscription.unique) and Subscription.reaches?(other, path)
    end)
  end
end
