defmodule BB.PubSub.Gate do
  @moduledoc """
  Decides, while a message is published, whether it goes to a subscription with `max_rate`,
  `max_queue` or `replay`.

  All that it remembers is in atomics, so that publishers decide at the same time without a lock:

    * the *counters* of a subscription - what passed and what did not, and how many messages it
      may be sent before somebody has to look at its mailbox again
    * the *cell* of a subscription and a source path - when the next message of that path is due,
      and which of them was replayed

  ## Looking at a mailbox

  The length of another process's mailbox costs about a microsecond while that process sleeps.
  While it runs, the answer waits for its turn to end, which may take a millisecond. So a look
  that finds room allows some messages more (an eighth of `max_queue`, as far as there is room)
  without another look, and one that took long and found none is not repeated before ten times as
  long has passed: a busy subscriber with a full mailbox costs a publisher a tenth of its time at
  most.

  ## Replaying

  The subscriber replays to itself. Its cell says of each path:

    * 0 - nothing was sent of this path
    * -k - the subscriber is about to replay the message number k, and has not begun
    * "sending k" - the subscriber has decided to, and does so in this very moment
    * k > 0 - that is dealt with: only greater numbers are news
    * "open" - everything is news

  A publisher with a newer message than k does not wait for a subscriber that has not begun. It
  sends its own, and the subscriber replays nothing of that path, since the last message is there
  already. Only while the subscriber sends does a publisher wait, for a millisecond at most: the
  VM does not take a process away between these few instructions, which stand at the beginning of
  its turn, but the operating system may take away the VM's thread. Then the publisher goes on,
  and the subscriber, once it is back, takes out of its mailbox what it had sent too late.

  An older message than the last one is not sent to a subscriber that has yet to replay that.
  """

  alias BB.Path
  alias BB.PubSub.{Bus, Pages, Passing, Retention, Subscription}

  @passed 1
  @dropped 2
  @filtered 3
  @missed 4
  @unreported 5
  @credits 6
  @look_after 7
  @over 8

  @replayed 1
  @due 2

  @untouched 0
  @sending 0x400_0000_0000_0000
  @open -0x400_0000_0000_0000

  @long_ns 200_000
  @long_ago -0x8000000000000000
  @patience_ns 1_000_000

  @type counters :: :atomics.atomics_ref()
  @type cell :: :atomics.atomics_ref()
  @type t ::
          {counters(), cell() | nil, Subscription.t()}
          | {:other_than, counters(), cell()}
          | :plain

  @typedoc "The number of a message among those of its retained path, and where that comes from."
  @type stamp :: {pos_integer(), Retention.sequence()} | nil

  @doc "The counters of a new subscription."
  @spec counters() :: counters()
  def counters do
    counters = :atomics.new(@over, [])
    :atomics.put(counters, @look_after, @long_ago)
    counters
  end

  @doc "What became of the messages: `{passed, dropped, filtered}`."
  @spec counted(counters()) :: {integer(), integer(), integer()}
  def counted(counters) do
    {:atomics.get(counters, @passed), :atomics.get(counters, @dropped),
     :atomics.get(counters, @filtered)}
  end

  @doc "Adds to what passed and to what was filtered."
  @spec correct(counters(), {integer(), integer()}) :: :ok
  def correct(counters, {passed, filtered}) do
    if passed != 0, do: :atomics.add(counters, @passed, passed)
    if filtered != 0, do: :atomics.add(counters, @filtered, filtered)
    :ok
  end

  @doc "How many messages were skipped because the mailbox was full."
  @spec missed(counters()) :: non_neg_integer()
  def missed(counters), do: :atomics.get(counters, @missed)

  @doc "A subscription's gate at a source path."
  @spec new(Bus.t(), Subscription.t(), Path.t(), boolean()) :: t()
  def new(bus, subscription, path, retained?) do
    cell? = subscription.period_ns != nil or (subscription.replay and retained?)
    {subscription.counters, if(cell?, do: cell(bus, subscription, path)), subscription}
  end

  @doc "A gate that lets everything pass but the message that was replayed to the same process."
  @spec other_than_replayed(Bus.t(), Subscription.t(), Path.t()) :: t()
  def other_than_replayed(bus, subscription, path),
    do: {:other_than, subscription.counters, cell(bus, subscription, path)}

  @doc "The cell of a subscription and a source path, the same one for all who ask."
  @spec cell(Bus.t(), Subscription.t(), Path.t()) :: cell()
  def cell(bus, %{id: id} = subscription, path) do
    case :ets.lookup(bus.cells, {id, path}) do
      [{_, cell}] -> cell
      [] -> new_cell(bus, subscription, path)
    end
  end

  # What is being forgotten in this moment, subscription or path, leaves no cell behind.
  defp new_cell(bus, %{id: id} = subscription, path) do
    cell = :atomics.new(@due, [])
    :atomics.put(cell, @due, @long_ago)

    if :ets.insert_new(bus.cells, {{id, path}, cell}) do
      unless Pages.member?(bus, subscription) and Passing.known?(bus, path),
        do: :ets.delete(bus.cells, {id, path})

      cell
    else
      present(bus, {id, path}, cell)
    end
  end

  defp present(bus, key, otherwise) do
    case :ets.lookup(bus.cells, key) do
      [{_, cell}] -> cell
      [] -> otherwise
    end
  end

  @doc """
  Sends the delivery through the first gate that is open; of several gates all belong to one
  process, which wants one copy.

  `number` is `nil` where no messages are kept.
  """
  @spec deliver([t()], pid(), term(), stamp()) :: :ok
  def deliver([], _pid, _delivery, _number), do: :ok

  def deliver([:plain | _], pid, delivery, _number) do
    send(pid, delivery)
    :ok
  end

  def deliver([{:other_than, counters, cell} | rest], pid, delivery, number) do
    if number != nil and replayed(cell, counters, number) == :same,
      do: :ok,
      else: deliver(rest, pid, delivery, number)
  end

  def deliver([{counters, _cell, subscription} = gate | rest], pid, delivery, number) do
    case verdict(gate, number) do
      :pass ->
        report_missed(counters, subscription)
        send(pid, delivery)
        :atomics.add(counters, @passed, 1)
        filtered(rest)

      :same ->
        filtered([gate | rest])

      :older ->
        filtered([gate])
        deliver(rest, pid, delivery, number)

      :dropped ->
        :atomics.add(counters, @dropped, 1)
        deliver(rest, pid, delivery, number)
    end
  end

  defp filtered([]), do: :ok

  defp filtered([{counters, _cell, _subscription} | rest]) do
    :atomics.add(counters, @filtered, 1)
    filtered(rest)
  end

  defp verdict({counters, cell, %{replay: true}} = gate, number)
       when cell != nil and number != nil do
    with :newer <- replayed(cell, counters, number), do: limits(gate)
  end

  defp verdict(gate, _number), do: limits(gate)

  # Rate

  defp limits({_, _, %{period_ns: nil}} = gate), do: queue(gate)

  defp limits({_, cell, %{period_ns: period_ns}} = gate) do
    due = :atomics.get(cell, @due)
    now = :erlang.monotonic_time(:nanosecond)

    with true <- now >= due,
         :pass <- queue(gate),
         :ok <- :atomics.compare_exchange(cell, @due, due, now + period_ns) do
      :pass
    else
      _ -> :dropped
    end
  end

  # Mailbox

  defp queue({_, _, %{max_queue: nil}}), do: :pass

  defp queue({counters, _, %{max_queue: max, pid: pid}}) do
    if :atomics.sub_get(counters, @credits, 1) >= 0 or look(counters, max, pid) do
      :pass
    else
      :atomics.add(counters, @missed, 1)
      :atomics.add(counters, @unreported, 1)
      :dropped
    end
  end

  defp look(counters, max, pid) do
    start = :erlang.monotonic_time(:nanosecond)

    if start >= :atomics.get(counters, @look_after) do
      info = Process.info(pid, :message_queue_len)
      room?(counters, max, info) or full(counters, start)
    else
      false
    end
  end

  defp room?(counters, max, {:message_queue_len, length}) when length <= max do
    :atomics.put(counters, @credits, min(max - length, div(max, 8)))
    true
  end

  defp room?(_counters, _max, _info), do: false

  defp full(counters, start) do
    now = :erlang.monotonic_time(:nanosecond)
    if now - start > @long_ns, do: :atomics.put(counters, @look_after, now + 10 * (now - start))
    false
  end

  defp report_missed(_counters, %{max_queue: nil}), do: :ok

  defp report_missed(counters, %{pid: pid, path: path}) do
    case :atomics.get(counters, @unreported) > 0 && :atomics.exchange(counters, @unreported, 0) do
      count when is_integer(count) and count > 0 -> send(pid, {:bb_missed, path, count})
      _ -> :ok
    end
  end

  # Replay

  @doc """
  Replays to the calling process: runs `fun`, which sends it the last message, number k of its
  path, unless a publisher is first. `take_back` takes it out of the mailbox again.
  """
  @spec replay(cell(), pos_integer(), (() -> any()), (() -> any())) :: :ok
  def replay(cell, k, fun, take_back) do
    with :ok <- swap(cell, @untouched, -k),
         # A new turn: it is long enough for what stands between the two marks.
         true <- :erlang.yield(),
         :ok <- swap(cell, -k, @sending + k) do
      fun.()

      # Asking takes what was sent to this process into its mailbox; until then signals of others
      # may overtake it.
      {:message_queue_len, _} = Process.info(self(), :message_queue_len)
      if swap(cell, @sending + k, k) != :ok, do: take_back.()
    end

    :ok
  end

  @doc "Says that the subscriber has replayed what there was."
  @spec replayed_all(counters()) :: :ok
  def replayed_all(counters), do: :atomics.put(counters, @over, 1)

  defp swap(cell, from, to), do: :atomics.compare_exchange(cell, @replayed, from, to)

  # Where a swap fails, somebody else was faster: look again.
  defp replayed(cell, counters, {n, sequence} = number) do
    case :atomics.get(cell, @replayed) do
      @open ->
        :newer

      @untouched ->
        untouched(cell, counters, n, sequence) || replayed(cell, counters, number)

      k when k > @sending ->
        sending(cell, k - @sending, n) || replayed(cell, counters, number)

      k when k < 0 and n > -k ->
        if swap(cell, k, -k) == :ok, do: :newer, else: replayed(cell, counters, number)

      k ->
        compare(n, abs(k))
    end
  end

  defp compare(k, k), do: :same
  defp compare(n, k) when n > k, do: :newer
  defp compare(_n, _k), do: :older

  # As long as the subscriber has yet to look, it gets the last message from whoever is first to
  # send it.
  defp untouched(cell, counters, n, sequence) do
    cond do
      :atomics.get(counters, @over) == 1 -> if swap(cell, @untouched, @open) == :ok, do: :newer
      :atomics.get(sequence, 1) == n -> if swap(cell, @untouched, n) == :ok, do: :newer
      true -> :older
    end
  end

  defp sending(_cell, k, n) when n <= k, do: compare(n, k)

  defp sending(cell, k, _n) do
    wait(cell, @sending + k, :erlang.monotonic_time(:nanosecond) + @patience_ns)
    if swap(cell, @sending + k, k) == :ok, do: :newer
  end

  defp wait(cell, state, until) do
    if :atomics.get(cell, @replayed) == state and :erlang.monotonic_time(:nanosecond) < until do
      :erlang.yield()
      wait(cell, state, until)
    end
  end
end
