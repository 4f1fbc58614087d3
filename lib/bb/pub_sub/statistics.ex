defmodule BB.PubSub.Statistics do
  @moduledoc """
  Works out how many messages each subscription got, without counting each delivery.

  `BB.PubSub.stats/1` reads the result, and `BB.PubSub.Registrar` keeps it right while
  subscriptions change:

      Statistics.rows(bus)

  A subscription without conditions gets every message of the permanent streams that reach it. Its
  *share* of their counts is the number that it got, and publishers count nothing for it while
  messages are published. Its own counters correct the share: by the messages published before it
  subscribed, and by those withheld from it with `except`. On transient paths each subscription
  counts for itself, so that forgetting a path changes no figure.
  """

  alias BB.Path

  alias BB.PubSub.{
    Bus,
    Meter,
    Plan,
    Streams,
    Subscription,
    Subscriptions,
    SubscriptionState
  }

  @typedoc "What `BB.PubSub.stats/1` reports of a subscription."
  @type row :: %{
          pid: pid(),
          path: Path.t(),
          message_types: [module()],
          delivered: non_neg_integer(),
          dropped: non_neg_integer(),
          filtered: non_neg_integer()
        }

  @typedoc "The messages delivered to each subscription and filtered from it, by its id."
  @type shares :: %{reference() => {delivered :: integer(), filtered :: integer()}}

  @typedoc "Streams with their meters."
  @type streams :: %{{Path.t(), module()} => Meter.t()} | [Streams.metered()]

  @doc "Returns the figures of every subscription."
  @spec rows(Bus.t()) :: [row()]
  def rows(bus) do
    shares = sum_shares(Streams.permanent(bus), &Subscriptions.reaching(bus, &1))
    for subscription <- Subscriptions.all(bus), do: row(subscription, shares)
  end

  defp row(subscription, shares) do
    {share_delivered, share_filtered} = Map.get(shares, subscription.id, {0, 0})
    {delivered, dropped, filtered} = SubscriptionState.counted(subscription.counters)

    %{
      pid: subscription.pid,
      path: subscription.path,
      message_types: subscription.message_types,
      delivered: max(share_delivered + delivered, 0),
      dropped: dropped,
      filtered: max(share_filtered + filtered, 0)
    }
  end

  @doc """
  Returns the shares of `subscriptions` in what the streams have counted so far.

  The subscriptions must be all of one process, or one that shares no copy with another.
  """
  @spec shares(streams(), [Subscription.t()]) :: shares()
  def shares(_streams, []), do: %{}

  def shares(streams, subscriptions) do
    sum_shares(streams, fn path ->
      Enum.filter(subscriptions, &Subscription.reaches?(&1, path))
    end)
  end

  @doc """
  Corrects the counters of `subscriptions` after a change, so that their figures are the same as
  before it.

  `shares_before` are their shares before the change. A subscription that has none there begins at
  0.
  """
  @spec correct(streams(), [Subscription.t()], shares()) :: :ok
  def correct(streams, subscriptions, shares_before) do
    shares_now = shares(streams, subscriptions)

    for %{id: id, counters: counters} <- subscriptions do
      {delivered, filtered} = Map.get(shares_before, id, {0, 0})
      {delivered_now, filtered_now} = Map.get(shares_now, id, {0, 0})
      SubscriptionState.add(counters, {delivered - delivered_now, filtered - filtered_now})
    end

    :ok
  end

  # `reached` returns the subscriptions that a path reaches, nearest first.
  defp sum_shares(streams, reached) do
    for {{path, type}, meter} <- streams,
        share <- stream_shares(reached.(path), type, meter),
        reduce: %{},
        do: (shares -> add(share, shares))
  end

  defp stream_shares([], _type, _meter), do: []

  defp stream_shares([only], type, meter) do
    cond do
      not Subscription.wants?(only, type) -> [{only.id, {0, Meter.counted(meter)}}]
      Subscription.conditional?(only) -> []
      true -> [{only.id, {Meter.counted(meter), 0}}]
    end
  end

  defp stream_shares(subscriptions, type, meter) do
    {steps, filtered} = Plan.new(subscriptions, type)
    count = Meter.counted(meter)

    delivered =
      for {_, [taker], _} <- steps,
          not Subscription.conditional?(taker),
          do: {taker.id, {count, 0}}

    delivered ++ for subscription <- filtered, do: {subscription.id, {0, count}}
  end

  defp add({id, {delivered, filtered}}, shares) do
    Map.update(shares, id, {delivered, filtered}, fn {d, f} -> {d + delivered, f + filtered} end)
  end
end
