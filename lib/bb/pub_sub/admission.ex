defmodule BB.PubSub.Admission do
  @moduledoc """
  Decides, while a message is published, whether a subscription with `max_rate`, `max_queue` or
  `replay` gets it.

  `BB.PubSub.Delivery` uses it for the subscriptions with one of these options; all others
  get a plain `send/2`. An admission combines `BB.PubSub.Replay`, `BB.PubSub.RateLimit` and
  `BB.PubSub.QueueLimit`, in this order:

      admission = Admission.new(subscription, Cells.find(bus, subscription, path, retained?))
      Admission.deliver([admission], pid, {:bb, path, message}, stamp)

  The check of an admission has one of four results. The counters are those of
  `BB.PubSub.stats/1`:

  | result | meaning | counter |
  |---|---|---|
  | `:pass` | the message is sent | `delivered` |
  | `:same` | it is the replayed message itself, and is not sent again | `filtered` |
  | `:older` | it was published before the replayed message | `filtered` |
  | `:dropped` | it exceeds the rate limit or the queue limit | `dropped` |

  After `:older` and `:dropped`, the next admission of the process is checked. After `:pass` and
  `:same`, the further ones are not checked, and count the message as `filtered`. The queue limit
  counts a dropped message in `BB.PubSub.missed/1` too.
  """

  require BB.PubSub.SubscriptionState

  alias BB.PubSub.{QueueLimit, RateLimit, Replay, Subscription, SubscriptionState}

  @type t ::
          {SubscriptionState.counters(), SubscriptionState.cell() | nil, Subscription.t()}
          | {:other_than, SubscriptionState.counters(), SubscriptionState.cell()}
          | :plain

  @doc "Returns the admission of a subscription at a path, given its cell there if it needs one."
  @spec new(Subscription.t(), SubscriptionState.cell() | nil) :: t()
  def new(subscription, cell), do: {subscription.counters, cell, subscription}

  @doc """
  Returns an admission that lets every message pass to the next one in the list, but for the
  message that was replayed to the same process.
  """
  @spec other_than_replayed(Subscription.t(), SubscriptionState.cell()) :: t()
  def other_than_replayed(subscription, cell), do: {:other_than, subscription.counters, cell}

  @doc """
  Sends the delivery to `pid` if one of its admissions lets it pass.

  All admissions in the list belong to one process, which gets one copy: by the first of them that
  lets the message pass. `stamp` is `nil` where no messages are kept.
  """
  @spec deliver([t()], pid(), term(), Replay.stamp()) :: :ok
  def deliver([], _pid, _delivery, _stamp), do: :ok

  def deliver([:plain | _], pid, delivery, _stamp) do
    send(pid, delivery)
    :ok
  end

  def deliver([{:other_than, counters, cell} | rest], pid, delivery, stamp) do
    if stamp != nil and Replay.compare(cell, counters, stamp) == :same,
      do: :ok,
      else: deliver(rest, pid, delivery, stamp)
  end

  def deliver([{counters, _cell, subscription} = admission | rest], pid, delivery, stamp) do
    case check(admission, stamp) do
      :pass ->
        report_missed(counters, subscription)
        send(pid, delivery)
        :atomics.add(counters, SubscriptionState.counter(:delivered), 1)
        count_filtered(rest)

      :same ->
        count_filtered([admission | rest])

      :older ->
        count_filtered([admission])
        deliver(rest, pid, delivery, stamp)

      :dropped ->
        :atomics.add(counters, SubscriptionState.counter(:dropped), 1)
        deliver(rest, pid, delivery, stamp)
    end
  end

  defp count_filtered([]), do: :ok

  defp count_filtered([{counters, _cell, _subscription} | rest]) do
    :atomics.add(counters, SubscriptionState.counter(:filtered), 1)
    count_filtered(rest)
  end

  defp check({counters, cell, %{replay: true}} = admission, stamp)
       when cell != nil and stamp != nil do
    with :newer <- Replay.compare(cell, counters, stamp), do: check_limits(admission)
  end

  defp check(admission, _stamp), do: check_limits(admission)

  defp check_limits({_, _, %{period_ns: nil}} = admission), do: check_queue(admission)

  defp check_limits({_, cell, %{period_ns: period_ns}} = admission) do
    due_ns = RateLimit.due_ns(cell)
    now_ns = :erlang.monotonic_time(:nanosecond)

    if now_ns >= due_ns and check_queue(admission) == :pass and
         RateLimit.reserve?(cell, due_ns, now_ns + period_ns),
       do: :pass,
       else: :dropped
  end

  defp check_queue({_, _, %{max_queue: nil}}), do: :pass

  defp check_queue({counters, _, %{max_queue: max_queue, pid: pid}}),
    do: if(QueueLimit.admit?(counters, max_queue, pid), do: :pass, else: :dropped)

  defp report_missed(_counters, %{max_queue: nil}), do: :ok

  defp report_missed(counters, %{pid: pid, path: path}),
    do: QueueLimit.report_missed(counters, pid, path)
end
