defmodule BB.PubSub.Traffic do
  @moduledoc """
  Counts what is published, at two atomics a message, and works out from that what each subscription got.

  Each source, a path and a payload type, has a meter: the number of its messages, and the times of the last sixteen. A
  publisher counts nothing for subscriptions: one without options gets everything of the sources that reach it, so what it got
  is what they have published since it came. A *tally* corrects that sum for each subscription: by what had been published
  before, and by what `except` withheld.
  """

  import Bitwise

  alias BB.Path
  alias BB.PubSub.{Bus, Gate, Routes, Subscription}

  @times 16

  @type meter :: :atomics.atomics_ref()
  @type topic :: %{
          path: Path.t(),
          type: module(),
          count: non_neg_integer(),
          rate_hz: float(),
          age_ns: integer()
        }
  @type row :: %{
          pid: pid(),
          path: Path.t(),
          message_types: [module()],
          delivered: non_neg_integer(),
          dropped: non_neg_integer(),
          filtered: non_neg_integer()
        }

  @doc "The meter of a source; a new source is told to the registrar."
  @spec meter(Bus.t(), Path.t(), module()) :: meter()
  def meter(bus, path, type) do
    key = {path, type}

    case :ets.lookup(bus.traffic, key) do
      [{_, meter}] -> meter
      [] -> new_meter(bus, key)
    end
  end

  defp new_meter(bus, {path, type} = key) do
    meter = :atomics.new(1 + @times, [])

    if :ets.insert_new(bus.traffic, {key, meter}) do
      GenServer.cast(bus.registrar, {:seen, path, type})
      meter
    else
      # Between the two lines the source may have been forgotten, if its path has a reference.
      case :ets.lookup(bus.traffic, key) do
        [{_, meter}] -> meter
        [] -> meter
      end
    end
  end

  @doc "`count/2` for an integer, without a call."
  defmacro tick(meter, time) do
    quote do
      number = :atomics.add_get(unquote(meter), 1, 1)
      :atomics.put(unquote(meter), 2 + :erlang.band(number, unquote(@times - 1)), unquote(time))
    end
  end

  @doc "Counts a message that was measured at `time`, Erlang monotonic time in nanoseconds."
  @spec count(meter(), integer()) :: :ok
  def count(meter, time) when is_integer(time), do: tick(meter, time)
  def count(meter, _time), do: count(meter, :erlang.monotonic_time(:nanosecond))

  @doc "How many messages were counted."
  @spec counted(meter()) :: non_neg_integer()
  def counted(meter), do: :atomics.get(meter, 1)

  @doc "The meters of the sources at exactly that path, one for each payload type."
  @spec meters(Bus.t(), Path.t()) :: [meter()]
  def meters(bus, path) do
    sources = :ets.select(bus.traffic, [{{{path, :_}, :_}, [], [:"$_"]}])
    for {{^path, _type}, meter} <- sources, do: meter
  end

  @doc "The time of the message that was counted last, of one that has counted some."
  @spec newest(meter()) :: integer()
  def newest(meter), do: time(meter, counted(meter))

  @doc "Every source and how it fares now, `now` in nanoseconds."
  @spec topics(Bus.t(), integer()) :: [topic()]
  def topics(bus, now) do
    for {{path, type}, meter} <- Enum.sort(:ets.tab2list(bus.traffic)),
        (count = counted(meter)) > 0,
        do: topic(path, type, count, times(meter, count), now)
  end

  defp topic(path, type, count, [newest | _] = times, now) do
    %{path: path, type: type, count: count, rate_hz: rate_hz(times, now), age_ns: now - newest}
  end

  # Newest first.
  defp times(meter, count) do
    times = for n <- count..max(count - @times + 1, 1)//-1, do: time(meter, n)
    Enum.sort(times, :desc)
  end

  defp time(meter, number), do: :atomics.get(meter, 2 + (number &&& @times - 1))

  @doc """
  The rate of messages with these times, newest first: over the last sixteen, and falling once the next is overdue.

      iex> BB.PubSub.Traffic.rate_hz([3_000_000, 2_000_000, 1_000_000], 3_000_000)
      1000.0
      iex> BB.PubSub.Traffic.rate_hz([3_000_000, 2_000_000, 1_000_000], 1_001_000_000)
      3.0
  """
  @spec rate_hz([integer(), ...], integer()) :: float()
  def rate_hz([_only], _now), do: 0.0

  def rate_hz([newest | rest], now) do
    oldest = List.last(rest)
    intervals = length(rest)
    period = (newest - oldest) / intervals

    cond do
      now - newest > period -> (intervals + 1) * 1.0e9 / (now - oldest)
      period > 0 -> 1.0e9 / period
      true -> 0.0
    end
  end

  @doc "What became of the messages for each subscription."
  @spec stats(Bus.t()) :: [row()]
  def stats(bus) do
    subscriptions = Bus.subscriptions(bus)
    shares = shares(:ets.tab2list(bus.traffic), &Bus.above(bus, &1), subscriptions)
    for subscription <- subscriptions, do: row(bus, subscription, shares)
  end

  defp row(bus, subscription, shares) do
    {share_delivered, share_filtered} = Map.get(shares, subscription.id, {0, 0})
    {tally_delivered, tally_filtered} = tally(bus, subscription)
    {passed, dropped, filtered} = Gate.counted(subscription.gate)

    %{
      pid: subscription.pid,
      path: subscription.path,
      message_types: subscription.message_types,
      delivered: max(share_delivered + tally_delivered + passed, 0),
      dropped: dropped,
      filtered: max(share_filtered + tally_filtered + filtered, 0)
    }
  end

  defp tally(bus, %{id: id}) do
    case :ets.lookup(bus.tallies, id) do
      [{_, delivered, filtered}] -> {delivered, filtered}
      [] -> {0, 0}
    end
  end

  @doc """
  How many of the messages counted so far go to each of the subscriptions and how many do not, `%{id => {delivered, filtered}}`,
  as the plan is now. `above` gives the subscriptions at and above a path.
  """
  @spec shares([{{Path.t(), module()}, meter()}], (Path.t() -> [Subscription.t()]), [
          Subscription.t()
        ]) :: %{reference() => {integer(), integer()}}
  def shares(sources, above, subscriptions) do
    for {{path, type}, meter} <- sources,
        Enum.any?(subscriptions, &Subscription.reaches?(&1, path)),
        share <- share(Routes.plan(above.(path), path, type), counted(meter)),
        reduce: %{} do
      shares -> add(share, shares)
    end
  end

  defp share({steps, filtered}, count) do
    got = for {_, [taker], _} <- steps, not Subscription.gated?(taker), do: {taker.id, {count, 0}}
    got ++ for subscription <- filtered, do: {subscription.id, {0, count}}
  end

  defp add({id, {delivered, filtered}}, shares) do
    Map.update(shares, id, {delivered, filtered}, fn {d, f} -> {d + delivered, f + filtered} end)
  end

  @doc "Corrects the tally of a subscription, if it is still there."
  @spec correct(Bus.t(), reference(), {integer(), integer()}) :: :ok
  def correct(bus, id, {delivered, filtered}) do
    _ = :ets.update_counter(bus.tallies, id, [{2, delivered}, {3, filtered}])
    :ok
  rescue
    ArgumentError -> :ok
  end
end
