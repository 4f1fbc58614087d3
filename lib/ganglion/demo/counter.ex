defmodule Ganglion.Demo.Counter do
  @moduledoc """
  Counts events and computes their rate.

  `Ganglion.Demo.Observation` uses it. Events are counted one by one (`hit/2`) or from a counter
  that is read from time to time (`reach/3`). Times are nanoseconds. It is pure.

      iex> alias Ganglion.Demo.Counter
      iex> counter = Enum.reduce([0, 500_000_000, 1_000_000_000], nil, &Counter.hit(&2, &1))
      iex> {counter.count, Counter.mean_rate(counter)}
      {3, 2.0}

  A counter that falls has started again from 0, as the counter of a new ring topic does. Its
  value is added then.

      iex> alias Ganglion.Demo.Counter
      iex> counter = Counter.start(100, 0) |> Counter.reach(130, 1_000_000_000)
      iex> Counter.reach(counter, 5, 2_000_000_000).count
      35
  """

  @enforce_keys [:count, :number, :first, :last, :look]
  defstruct [:count, :number, :first, :last, :look]

  @typedoc """
  The `count` of events and the `number` that was last read. `first`, `last` and `look` are the
  count and the time at the first event, at the last event and at the last `look/1`.
  """
  @type t :: %__MODULE__{
          count: non_neg_integer(),
          number: non_neg_integer(),
          first: mark(),
          last: mark(),
          look: mark()
        }
  @typedoc "A count and the time at which it was reached."
  @type mark :: {non_neg_integer(), integer()}

  @doc "Returns a counter without events. Events up to `number` do not count."
  @spec start(non_neg_integer(), integer()) :: t()
  def start(number, now), do: new(0, number, now)

  @doc "Counts one event."
  @spec hit(t() | nil, integer()) :: t()
  def hit(nil, now), do: new(1, 1, now)
  def hit(counter, now), do: reach(counter, counter.number + 1, now)

  @doc "Counts the events since `number` was last read. The first number counts as a whole."
  @spec reach(t() | nil, non_neg_integer(), integer()) :: t()
  def reach(nil, number, now), do: new(number, number, now)

  def reach(%{number: before} = counter, number, now) do
    count = counter.count + if(number >= before, do: number - before, else: number)
    %{counter | count: count, number: number, last: {count, now}}
  end

  @doc "Starts a new interval for `rate/1`."
  @spec look(t()) :: t()
  def look(counter), do: %{counter | look: counter.last}

  @doc "Returns the events per second since the last `look/1`."
  @spec rate(t()) :: float()
  def rate(%{look: look, last: last}), do: per_second(look, last)

  @doc "Returns the events per second from the first to the last event."
  @spec mean_rate(t()) :: float()
  def mean_rate(%{first: first, last: last}), do: per_second(first, last)

  @doc "Returns the nanoseconds since the last event."
  @spec age(t(), integer()) :: integer()
  def age(%{last: {_count, time}}, now), do: now - time

  defp new(count, number, now) do
    mark = {count, now}
    %__MODULE__{count: count, number: number, first: mark, last: mark, look: mark}
  end

  defp per_second({from, start}, {to, finish}) when finish > start,
    do: (to - from) * 1.0e9 / (finish - start)

  defp per_second(_from, _to), do: 0.0
end
