defmodule BB.PubSub.SubscriptionState do
  @moduledoc """
  The state of a subscription that publishers share: atomics, which any number of publishers read
  and write at the same time without a lock.

  `BB.PubSub.RateLimit`, `BB.PubSub.QueueLimit` and `BB.PubSub.Replay` decide by it whether a
  message is delivered. There are two kinds:

    * the *counters*, one array for each subscription: how many messages were delivered, dropped,
      filtered and missed, and the state of the queue limit
    * a *cell*, one array for each subscription and path: when the next message of that path is
      due, and the state of its replay. `BB.PubSub.Cells` keeps them.

  The macros `counter/1` and `word/1` turn the name of a word into its index at compile time:

      :atomics.add(counters, SubscriptionState.counter(:dropped), 1)
  """

  @counters [
    delivered: 1,
    dropped: 2,
    filtered: 3,
    missed: 4,
    unreported: 5,
    allowance: 6,
    next_check_ns: 7,
    replays_over: 8
  ]
  @cell [replay: 1, due_ns: 2]

  # Before any time that the clock may show.
  @long_ago_ns -0x8000000000000000

  @type counters :: :atomics.atomics_ref()
  @type cell :: :atomics.atomics_ref()

  @doc "Returns the index of a word in a subscription's counters."
  defmacro counter(name), do: Keyword.fetch!(@counters, name)

  @doc "Returns the index of a word in a cell."
  defmacro word(name), do: Keyword.fetch!(@cell, name)

  @doc "Creates the counters of a new subscription."
  @spec new_counters() :: counters()
  def new_counters do
    counters = :atomics.new(length(@counters), [])
    :atomics.put(counters, counter(:next_check_ns), @long_ago_ns)
    counters
  end

  @doc "Creates the cell of a subscription at a path that it has not met yet."
  @spec new_cell() :: cell()
  def new_cell do
    cell = :atomics.new(length(@cell), [])
    :atomics.put(cell, word(:due_ns), @long_ago_ns)
    cell
  end

  @doc "Returns how many messages were counted as `{delivered, dropped, filtered}`."
  @spec counted(counters()) :: {integer(), integer(), integer()}
  def counted(counters) do
    {:atomics.get(counters, counter(:delivered)), :atomics.get(counters, counter(:dropped)),
     :atomics.get(counters, counter(:filtered))}
  end

  @doc """
  Adds to the messages delivered and to the messages filtered.

  Either number may be negative.
  """
  @spec add(counters(), {integer(), integer()}) :: :ok
  def add(counters, {delivered, filtered}) do
    if delivered != 0, do: :atomics.add(counters, counter(:delivered), delivered)
    if filtered != 0, do: :atomics.add(counters, counter(:filtered), filtered)
    :ok
  end
end
