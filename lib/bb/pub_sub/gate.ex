defmodule BB.PubSub.Gate do
  @moduledoc """
  Decides, while a message is published, whether it goes to a subscription with `max_rate`, `max_queue` or `replay`.

  All that it remembers is in atomics, so that publishers decide at the same time without a lock:

    * the *counters* of a subscription - what passed and what did not, and how many messages it may be sent before somebody
      has to look at its mailbox again
    * the *cell* of a subscription and a source path - when the next message of that path is due, and which of them was
      replayed

  ## Looking at a mailbox

  The length of another process's mailbox costs about a microsecond while that process sleeps. While it runs, the answer
  waits for its turn to end, which may take a millisecond. So a look that finds room allows some messages more (an eighth of
  `max_queue`, as far as there is room) without another look, and one that took long and found none is not repeated before
  ten times as long has passed: a busy subscriber with a full mailbox costs a publisher a tenth of its time at most.

  ## Replaying

  The subscriber replays to itself. Its cell says of each path:

    * 0 - nothing has been sent of this path
    * -1 - the subscriber is replaying the last message; whoever publishes a newer one waits these microseconds
    * n > 0 - the message number n was replayed: only greater numbers are news
    * -2 - a publisher was first: what it sent was the last message, and there is nothing to replay
  """

  alias BB.Path
  alias BB.PubSub.{Bus, Subscription}

  @passed 1
  @dropped 2
  @filtered 3
  @missed 4
  @unreported 5
  @credits 6
  @look_after 7

  @replayed 1
  @due 2

  @untouched 0
  @replaying -1
  @open -2

  @long_ns 200_000
  @long_ago -0x8000000000000000
  @yields 50
  @waits 100

  @type counters :: :atomics.atomics_ref()
  @type cell :: :atomics.atomics_ref()
  @type t ::
          {counters(), cell() | nil, Subscription.t()} | {:other_than, cell()} | :plain

  @doc "The counters of a new subscription."
  @spec counters() :: counters()
  def counters do
    counters = :atomics.new(7, [])
    :atomics.put(counters, @look_after, @long_ago)
    counters
  end

  @doc "What became of the messages: `{passed, dropped, filtered}`."
  @spec counted(counters() | nil) :: {integer(), integer(), integer()}
  def counted(nil), do: {0, 0, 0}

  def counted(counters) do
    {:atomics.get(counters, @passed), :atomics.get(counters, @dropped),
     :atomics.get(counters, @filtered)}
  end

  @doc "How many messages were skipped because the mailbox was full."
  @spec missed(counters() | nil) :: non_neg_integer()
  def missed(nil), do: 0
  def missed(counters), do: :atomics.get(counters, @missed)

  @doc "A subscription's gate at a source path."
  @spec new(Bus.t(), Subscription.t(), Path.t(), boolean()) :: t()
  def new(bus, subscription, path, retained?) do
    cell? = subscription.period_ns != nil or (subscription.replay and retained?)
    {subscription.gate, if(cell?, do: cell(bus, subscription, path)), subscription}
  end

  @doc "A gate that lets everything pass but the message that was replayed to the same process."
  @spec other_than_replayed(Bus.t(), Subscription.t(), Path.t()) :: t()
  def other_than_replayed(bus, subscription, path),
    do: {:other_than, cell(bus, subscription, path)}

  @doc "The cell of a subscription and a source path, the same one for all who ask."
  @spec cell(Bus.t(), Subscription.t(), Path.t()) :: cell()
  def cell(bus, %{id: id}, path) do
    key = {id, path}

    case :ets.lookup(bus.cells, key) do
      [{_, cell}] -> cell
      [] -> new_cell(bus, key)
    end
  end

  defp new_cell(bus, key) do
    cell = :atomics.new(2, [])
    :atomics.put(cell, @due, @long_ago)

    if :ets.insert_new(bus.cells, {key, cell}),
      do: cell,
      else: :ets.lookup_element(bus.cells, key, 2)
  end

  @doc """
  Sends the delivery through the first gate that is open; of several gates all belong to one process, which wants one copy.

  `number` counts the messages of a retained path and is `nil` elsewhere.
  """
  @spec deliver([t()], pid(), term(), pos_integer() | nil) :: :ok
  def deliver([], _pid, _delivery, _number), do: :ok

  def deliver([:plain | _], pid, delivery, _number) do
    send(pid, delivery)
    :ok
  end

  def deliver([{:other_than, cell} | rest], pid, delivery, number) do
    if replayed(cell, number, pid, 0) == :same,
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

  defp verdict({_counters, cell, %{replay: true, pid: pid}} = gate, number)
       when cell != nil and number != nil do
    with :newer <- replayed(cell, number, pid, 0), do: limits(gate)
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
  Replays to the calling process: runs `fun`, which sends the last message and returns its number, unless a publisher was first.
  """
  @spec replay(cell(), (() -> non_neg_integer())) :: :ok
  def replay(cell, fun) do
    case :atomics.compare_exchange(cell, @replayed, @untouched, @replaying) do
      :ok ->
        number = fun.()

        # Asking takes what was sent to this process into its mailbox; until then signals of others may overtake it.
        {:message_queue_len, _} = Process.info(self(), :message_queue_len)
        :atomics.put(cell, @replayed, max(number, @untouched))

      _ ->
        :ok
    end
  end

  defp replayed(cell, number, pid, tries) do
    case :atomics.get(cell, @replayed) do
      @open -> :newer
      @untouched -> open(cell, number, pid, tries)
      @replaying -> wait(cell, number, pid, tries)
      ^number -> :same
      replayed when number > replayed -> :newer
      _ -> :older
    end
  end

  defp open(cell, number, pid, tries) do
    case :atomics.compare_exchange(cell, @replayed, @untouched, @open) do
      :ok -> :newer
      _ -> replayed(cell, number, pid, tries)
    end
  end

  # A subscriber that was suspended in the middle must not hold up publishers for good.
  defp wait(cell, number, pid, tries) do
    cond do
      not Process.alive?(pid) -> :older
      tries > @yields + @waits -> :newer
      true -> wait_again(cell, number, pid, tries)
    end
  end

  defp wait_again(cell, number, pid, tries) do
    pause(tries)
    replayed(cell, number, pid, tries + 1)
  end

  defp pause(tries) when tries < @yields, do: :erlang.yield()

  # Sleeping lets a subscriber of lower priority finish.
  defp pause(_tries) do
    receive do
    after
      1 -> true
    end
  end
end
