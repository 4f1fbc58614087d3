defmodule BB.PubSub.QueueLimit do
  @moduledoc """
  The mailbox limit of a subscription: the option `max_queue` of `BB.PubSub.subscribe/3`.

  `BB.PubSub.Admission` uses it while a message is published: a subscriber with more messages than
  that in its mailbox is skipped, and each skipped message is counted.

      if QueueLimit.admit?(counters, max_queue, pid), do: send(pid, delivery)

  ## The cost of checking a mailbox

  `Process.info/2` of a sleeping process takes about a microsecond. Of a running process, it waits
  until that process's time slice ends, which may take a millisecond. Two rules keep publishers
  fast:

    * A check that finds room gives an allowance: an eighth of `max_queue`, or less if there is
      less room. As many messages are sent without another check.
    * A check that takes long and finds no room is not repeated before ten times as long has
      passed. A busy subscriber with a full mailbox costs a publisher at most a tenth of its time.
  """

  require BB.PubSub.SubscriptionState

  alias BB.Path
  alias BB.PubSub.SubscriptionState

  # A check that takes longer than this is long.
  @long_ns 200_000

  @doc "Returns whether the mailbox has room for a message. Counts the message as missed if not."
  @spec admit?(SubscriptionState.counters(), non_neg_integer(), pid()) :: boolean()
  def admit?(counters, max_queue, pid) do
    if :atomics.sub_get(counters, SubscriptionState.counter(:allowance), 1) >= 0 or
         check_mailbox(counters, max_queue, pid) do
      true
    else
      :atomics.add(counters, SubscriptionState.counter(:missed), 1)
      :atomics.add(counters, SubscriptionState.counter(:unreported), 1)
      false
    end
  end

  defp check_mailbox(counters, max_queue, pid) do
    start_ns = :erlang.monotonic_time(:nanosecond)

    if start_ns >= :atomics.get(counters, SubscriptionState.counter(:next_check_ns)) do
      info = Process.info(pid, :message_queue_len)
      give_allowance(counters, max_queue, info) or postpone_check(counters, start_ns)
    else
      false
    end
  end

  defp give_allowance(counters, max_queue, {:message_queue_len, length})
       when length <= max_queue do
    allowance = min(max_queue - length, div(max_queue, 8))
    :atomics.put(counters, SubscriptionState.counter(:allowance), allowance)
    true
  end

  defp give_allowance(_counters, _max_queue, _info), do: false

  defp postpone_check(counters, start_ns) do
    now_ns = :erlang.monotonic_time(:nanosecond)
    next_ns = now_ns + 10 * (now_ns - start_ns)

    if now_ns - start_ns > @long_ns,
      do: :atomics.put(counters, SubscriptionState.counter(:next_check_ns), next_ns)

    false
  end

  @doc """
  Sends `{:bb_missed, path, count}` to the subscriber if messages were missed since the last such
  report.
  """
  @spec report_missed(SubscriptionState.counters(), pid(), Path.t()) :: :ok
  def report_missed(counters, pid, path) do
    unreported = SubscriptionState.counter(:unreported)

    count =
      if :atomics.get(counters, unreported) > 0,
        do: :atomics.exchange(counters, unreported, 0),
        else: 0

    _ = if count > 0, do: send(pid, {:bb_missed, path, count})
    :ok
  end

  @doc "Returns how many messages were missed since the process subscribed."
  @spec missed(SubscriptionState.counters()) :: non_neg_integer()
  def missed(counters), do: :atomics.get(counters, SubscriptionState.counter(:missed))
end
