defmodule BB.PubSub.Traffic do
  @moduledoc """
  Counts what is published, at two atomics a message, and works out from that what each
  subscription got.

  Each source, a path and a payload type, has a meter: the number of its messages, and the times
  of the last sixteen. Where the path lasts (`BB.PubSub.Passing`), a publisher counts nothing for
  subscriptions: one without options gets everything of the sources that reach it, so what it got
  is what they have published since it came. The subscription's own counters correct that sum: by
  what had been published before, and by what `except` withheld. Where the path is a passing one,
  each subscription counts for itself.

  ## Versions

  The number of messages stands in the low bits of a word, and in the high ones a version: that of
  the route which publishers may take. The registrar raises it before it changes who is
  subscribed, so a publisher whose route is out of date learns that by counting its message, for
  nothing more, and looks up the subscriptions itself.
  """

  import Bitwise

  alias BB.Path
  alias BB.PubSub.{Bus, Gate, Pages, Passing, Routes, Subscription}

  @times 16

  # A word has 64 bits, of which the VM keeps 60 without a heap: a sign, 14 of the version, 44 for
  # 17 million million messages.
  @count_bits 44
  @version 1 <<< @count_bits
  @versions 1 <<< 14

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

  @doc """
  The meter of a source, and whether its path is a lasting or a passing one. A new source that
  lasts is told to the registrar.
  """
  @spec source(Bus.t(), Path.t(), module()) :: {:lasting | :passing, meter()}
  def source(bus, path, type) do
    key = {path, type}

    case {:ets.lookup(bus.traffic, key), :ets.lookup(bus.passing, key)} do
      {[{_, meter}], _} -> {:lasting, meter}
      {[], [{_, meter}]} -> {:passing, meter}
      {[], []} -> new_source(bus, key)
    end
  end

  defp new_source(bus, {path, _type} = key) do
    if Passing.lasting?(bus, path),
      do: {:lasting, new_lasting(bus, key)},
      else: {:passing, new_passing(bus, key)}
  end

  defp new_lasting(bus, {path, type} = key) do
    meter = new_meter()

    if :ets.insert_new(bus.traffic, {key, meter}) do
      GenServer.cast(bus.registrar, {:seen, path, type})
      meter
    else
      :ets.lookup_element(bus.traffic, key, 2)
    end
  end

  defp new_passing(bus, {path, _type} = key) do
    meter = new_meter()
    :ok = Passing.remember(bus, path)
    inserted? = :ets.insert_new(bus.passing, {key, meter})
    if inserted? and not Passing.member?(bus, path), do: :ets.delete(bus.passing, key)
    if inserted?, do: meter, else: present(bus, key, meter)
  end

  # It may have been forgotten meanwhile.
  defp present(bus, key, otherwise) do
    case :ets.lookup(bus.passing, key) do
      [{_, meter}] -> meter
      [] -> otherwise
    end
  end

  defp new_meter, do: :atomics.new(1 + @times, [])

  @doc "`count/2` for an integer, without a call."
  defmacro tick(meter, time) do
    quote do
      word = :atomics.add_get(unquote(meter), 1, 1)
      :atomics.put(unquote(meter), 2 + :erlang.band(word, unquote(@times - 1)), unquote(time))
      word
    end
  end

  @doc "Whether the route of that version may be taken, by the word of `tick/2`. Without a call."
  defmacro current?(word, version),
    do: quote(do: :erlang.bsr(unquote(word), unquote(@count_bits)) == unquote(version))

  @doc """
  Counts a message that was measured at `time`, Erlang monotonic time in nanoseconds. Gives the
  word that `current?/2` looks at.
  """
  @spec count(meter(), term()) :: pos_integer()
  def count(meter, time) when is_integer(time), do: tick(meter, time)
  def count(meter, _time), do: count(meter, :erlang.monotonic_time(:nanosecond))

  @doc "How many messages were counted."
  @spec counted(meter()) :: non_neg_integer()
  def counted(meter), do: :atomics.get(meter, 1) &&& @version - 1

  @doc "The version of the route that publishers may take."
  @spec version(meter()) :: non_neg_integer()
  def version(meter), do: :atomics.get(meter, 1) >>> @count_bits

  @doc "Puts all routes of the source out of date. For the registrar alone."
  @spec outdate(meter()) :: :ok
  def outdate(meter) do
    case version(meter) + 1 do
      @versions -> :atomics.sub(meter, 1, (@versions - 1) * @version)
      _ -> :atomics.add(meter, 1, @version)
    end
  end

  @doc "The meters of the sources at exactly that path, one for each payload type."
  @spec meters(Bus.t(), Path.t()) :: [meter()]
  def meters(bus, path) do
    for table <- [bus.traffic, bus.passing],
        {{^path, type}, meter} <- :ets.select(table, [{{{path, :_}, :_}, [], [:"$_"]}]),
        is_atom(type),
        do: meter
  end

  @doc "The time of the message that was counted last, of one that has counted some."
  @spec newest(meter()) :: integer()
  def newest(meter), do: time(meter, counted(meter))

  @doc "Every source and how it fares now, `now` in nanoseconds."
  @spec topics(Bus.t(), integer()) :: [topic()]
  def topics(bus, now) do
    for {{path, type}, meter} <- Enum.sort(lasting(bus) ++ passing(bus)),
        (count = counted(meter)) > 0,
        do: topic(path, type, count, times(meter, count), now)
  end

  @doc "The sources that last, each with its meter."
  @spec lasting(Bus.t()) :: [{{Path.t(), module()}, meter()}]
  def lasting(bus), do: :ets.tab2list(bus.traffic)

  defp passing(bus) do
    for {{path, type}, meter} <- :ets.tab2list(bus.passing), is_list(path), is_atom(type) do
      {{path, type}, meter}
    end
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
  The rate of messages with these times, newest first: over the last sixteen, and falling once the
  next is overdue.

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
    shares = shares(lasting(bus), &Pages.above(bus, &1))
    for subscription <- Pages.all(bus), do: row(subscription, shares)
  end

  defp row(subscription, shares) do
    {share_delivered, share_filtered} = Map.get(shares, subscription.id, {0, 0})
    {passed, dropped, filtered} = Gate.counted(subscription.counters)

    %{
      pid: subscription.pid,
      path: subscription.path,
      message_types: subscription.message_types,
      delivered: max(share_delivered + passed, 0),
      dropped: dropped,
      filtered: max(share_filtered + filtered, 0)
    }
  end

  @doc """
  How many of the messages counted so far go to each subscription and how many do not, `%{id =>
  {delivered, filtered}}`, going by who is subscribed now. `above` gives the subscriptions that
  hear of a path, nearest first.
  """
  @spec shares([{{Path.t(), module()}, meter()}], (Path.t() -> [Subscription.t()])) ::
          %{reference() => {integer(), integer()}}
  def shares(sources, above) do
    for {{path, type}, meter} <- sources,
        share <- share(above.(path), type, meter),
        reduce: %{},
        do: (shares -> add(share, shares))
  end

  defp share([], _type, _meter), do: []

  defp share([only], type, meter) do
    cond do
      not Subscription.wants?(only, type) -> [{only.id, {0, counted(meter)}}]
      Subscription.gated?(only) -> []
      true -> [{only.id, {counted(meter), 0}}]
    end
  end

  defp share(subscriptions, type, meter) do
    {steps, filtered} = Routes.plan(subscriptions, type)
    count = counted(meter)
    got = for {_, [taker], _} <- steps, not Subscription.gated?(taker), do: {taker.id, {count, 0}}
    got ++ for subscription <- filtered, do: {subscription.id, {0, count}}
  end

  defp add({id, {delivered, filtered}}, shares) do
    Map.update(shares, id, {delivered, filtered}, fn {d, f} -> {d + delivered, f + filtered} end)
  end
end
