defmodule BB.PubSub.Replay do
  @moduledoc """
  The replay protocol: how a subscriber with `replay: true` and the publishers agree, for each
  retained path, on the first message that the subscriber gets.

  `BB.PubSub.Retention` runs the subscriber's side, `BB.PubSub.Admission` the publishers'. The
  messages of a path are numbered. The subscriber sends the last one to itself, and everything
  newer must follow it once and in order, whenever publishers publish:

      Replay.run(cell, number, fn -> send(self(), delivery) end, fn -> take_back(delivery) end)
      Replay.compare(cell, counters, {number, sequence})
      #=> :newer

  ## The states of a path

  The cell of a subscription at a path holds one of these:

    * 0 - no message of this path was sent
    * -k - the subscriber has announced that it will replay message number k
    * "sending k" - the subscriber is sending message number k at this moment
    * k > 0 - the messages up to number k are dealt with; only greater numbers are new
    * "open" - every message is new

  A publisher with a newer message than k does not wait for a subscriber that has only announced
  its replay. It sends its own message, and the subscriber then replays nothing of that path,
  since the last message is in its mailbox already.

  A publisher waits only while the subscriber sends, and for a millisecond at most. Those few
  instructions stand at the beginning of the subscriber's time slice, so the VM does not suspend
  the process between them; only the operating system can, by suspending the VM's thread. After
  the millisecond the publisher continues, and the subscriber removes from its own mailbox what it
  sent too late.

  Before a subscriber has replayed the last message of a path, it gets no older one.

  ## Example

  The last message of a path has number 7 when a process subscribes. Without a publisher:

  | event | the cell | the mailbox |
  |---|---|---|
  | the subscriber announces message 7 | 0 → -7 | |
  | it begins to send message 7 | -7 → "sending 7" | |
  | it has sent message 7 | "sending 7" → 7 | 7 |
  | a publisher sends message 8 | 7 | 7, 8 |

  With a publisher of message 8 between the announcement and the sending:

  | event | the cell | the mailbox |
  |---|---|---|
  | the subscriber announces message 7 | 0 → -7 | |
  | the publisher sends message 8 | -7 → 7 | 8 |
  | the subscriber finds 7 instead of -7, and replays nothing | 7 | 8 |

  With such a publisher while the subscriber's thread is suspended:

  | event | the cell | the mailbox |
  |---|---|---|
  | the subscriber sends message 7 and is suspended | "sending 7" | 7 |
  | the publisher has waited for a millisecond, and sends message 8 | "sending 7" → 7 | 7, 8 |
  | the subscriber finds 7 instead of "sending 7", and removes message 7 | 7 | 8 |
  """

  require BB.PubSub.SubscriptionState

  alias BB.PubSub.SubscriptionState

  @untouched 0
  @sending 0x400_0000_0000_0000
  @open -0x400_0000_0000_0000

  @patience_ns 1_000_000

  @typedoc "The counter from which the messages of a retained path get their numbers."
  @type sequence :: :atomics.atomics_ref()

  @typedoc "The number of a message on its retained path, with the counter it comes from."
  @type stamp :: {pos_integer(), sequence()} | nil

  @doc """
  Replays a message to the calling process, the subscriber.

  Calls `fun` to send message number `k` of the path, unless a publisher sent a newer one first.
  Calls `take_back` to remove it from the mailbox again if a publisher stopped waiting.
  """
  @spec run(SubscriptionState.cell(), pos_integer(), (() -> any()), (() -> any())) :: :ok
  def run(cell, k, fun, take_back) do
    with :ok <- swap(cell, @untouched, -k),
         # A new time slice: it is long enough for the instructions between the two swaps.
         true <- :erlang.yield(),
         :ok <- swap(cell, -k, @sending + k) do
      fun.()

      # Process.info/2 moves what was sent to this process into its mailbox. Until then, signals
      # of other processes may overtake it.
      {:message_queue_len, _} = Process.info(self(), :message_queue_len)
      if swap(cell, @sending + k, k) != :ok, do: take_back.()
    end

    :ok
  end

  @doc "Marks the replays of a subscription as finished."
  @spec finish(SubscriptionState.counters()) :: :ok
  def finish(counters), do: :atomics.put(counters, SubscriptionState.counter(:replays_over), 1)

  defp swap(cell, from, to),
    do: :atomics.compare_exchange(cell, SubscriptionState.word(:replay), from, to)

  @doc """
  Compares a publisher's message with the message that the subscriber got last.

  Returns `:newer` for a message that is to be sent, `:same` for the replayed message itself, and
  `:older` for one that was published before it.
  """
  @spec compare(SubscriptionState.cell(), SubscriptionState.counters(), stamp()) ::
          :newer | :same | :older
  def compare(cell, counters, {n, sequence} = stamp) do
    # A swap fails when another process has changed the state: then it is read again.
    case :atomics.get(cell, SubscriptionState.word(:replay)) do
      @open ->
        :newer

      @untouched ->
        compare_untouched(cell, counters, n, sequence) || compare(cell, counters, stamp)

      k when k > @sending ->
        compare_sending(cell, k - @sending, n) || compare(cell, counters, stamp)

      k when k < 0 and n > -k ->
        if swap(cell, k, -k) == :ok, do: :newer, else: compare(cell, counters, stamp)

      k ->
        compare_numbers(n, abs(k))
    end
  end

  defp compare_numbers(k, k), do: :same
  defp compare_numbers(n, k) when n > k, do: :newer
  defp compare_numbers(_n, _k), do: :older

  # Until the subscriber has looked at this path, it gets the last message from the publisher that
  # is the first to send it.
  defp compare_untouched(cell, counters, n, sequence) do
    cond do
      :atomics.get(counters, SubscriptionState.counter(:replays_over)) == 1 ->
        if swap(cell, @untouched, @open) == :ok, do: :newer

      :atomics.get(sequence, 1) == n ->
        if swap(cell, @untouched, n) == :ok, do: :newer

      true ->
        :older
    end
  end

  defp compare_sending(_cell, k, n) when n <= k, do: compare_numbers(n, k)

  defp compare_sending(cell, k, _n) do
    await_change(cell, @sending + k, :erlang.monotonic_time(:nanosecond) + @patience_ns)
    if swap(cell, @sending + k, k) == :ok, do: :newer
  end

  defp await_change(cell, state, deadline_ns) do
    if :atomics.get(cell, SubscriptionState.word(:replay)) == state and
         :erlang.monotonic_time(:nanosecond) < deadline_ns do
      :erlang.yield()
      await_change(cell, state, deadline_ns)
    end
  end
end
