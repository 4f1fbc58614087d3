defmodule BB.PubSub.Delivery do
  @moduledoc """
  Sends a message to the targets of its route, in the publisher's process.

  `BB.PubSub.publish/4` uses it for every message. A target is a pid, which gets a plain `send/2`,
  or a pid with the admissions of its subscriptions that have conditions:

      Delivery.deliver(targets, {:bb, path, message}, stamp)
  """

  alias BB.Path

  alias BB.PubSub.{
    Admission,
    Bus,
    Cells,
    Plan,
    Replay,
    Routes,
    Streams,
    Subscription,
    Subscriptions,
    SubscriptionState
  }

  @doc "Returns the targets for the steps of a plan."
  @spec targets(Bus.t(), [Plan.step()], Path.t()) :: [Routes.target()]
  def targets(bus, steps, path) do
    retained? = Bus.retained?(bus, path)
    for step <- steps, do: target(bus, step, path, retained?)
  end

  defp target(bus, {pid, [taker], shadowed}, path, retained?) do
    replaying = for %{replay: true} = other <- shadowed, retained?, do: other

    case {Subscription.conditional?(taker), replaying} do
      {true, _} -> {pid, [admission(bus, taker, path, retained?)]}
      {false, []} -> pid
      {false, _} -> {pid, Enum.map(replaying, &other_than_replayed(bus, &1, path)) ++ [:plain]}
    end
  end

  defp target(bus, {pid, takers, []}, path, retained?),
    do: {pid, Enum.map(takers, &admission(bus, &1, path, retained?))}

  defp admission(bus, subscription, path, retained?),
    do: Admission.new(subscription, Cells.find(bus, subscription, path, retained?))

  defp other_than_replayed(bus, subscription, path),
    do: Admission.other_than_replayed(subscription, Cells.fetch(bus, subscription, path))

  @doc "Sends the delivery to all targets."
  @spec deliver([Routes.target()], term(), Replay.stamp()) :: :ok
  def deliver([pid | rest], delivery, stamp) when is_pid(pid) do
    send(pid, delivery)
    deliver(rest, delivery, stamp)
  end

  def deliver([{pid, admissions} | rest], delivery, stamp) do
    Admission.deliver(admissions, pid, delivery, stamp)
    deliver(rest, delivery, stamp)
  end

  def deliver([], _delivery, _stamp), do: :ok

  @doc """
  Sends the delivery to the subscribers that the tables list, except to the pids in `except`.

  This is for publishers without a route or with an option. It counts deliveries where the meter
  of the stream does not show them.
  """
  @spec unrouted(Bus.t(), stream, [pid()], term(), Replay.stamp()) :: :ok
        when stream: {Path.t(), module(), Streams.class()}
  def unrouted(bus, {path, type, class}, except, delivery, stamp) do
    {steps, filtered} = Plan.new(Subscriptions.reaching(bus, path), type)
    retained? = Bus.retained?(bus, path)
    if class == :transient, do: Enum.each(filtered, &SubscriptionState.add(&1.counters, {0, 1}))

    for {pid, [first | _], _shadowed} = step <- steps do
      withheld? = except != [] and pid in except
      unless Subscription.conditional?(first), do: count(first.counters, class, withheld?)
      unless withheld?, do: deliver([target(bus, step, path, retained?)], delivery, stamp)
    end

    :ok
  end

  defp count(counters, :transient, false), do: SubscriptionState.add(counters, {1, 0})
  defp count(counters, :permanent, true), do: SubscriptionState.add(counters, {-1, 0})
  defp count(_counters, _class, _withheld?), do: :ok
end
