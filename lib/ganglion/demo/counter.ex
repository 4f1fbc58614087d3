defmodule Ganglion.Demo.Counter do
  @moduledoc """
  Something that counts up, seen one by one (`hit/2`) or by a number that is read now and then (`reach/3`). Times are nanoseconds.

      iex> alias Ganglion.Demo.Counter
      iex> counter = nil |> Counter.hit(0) |> Counter.hit(500_000_000) |> Counter.hit(1_000_000_000)
      iex> {counter.count, Counter.mean_rate(counter)}
      {3, 2.0}

  A number that falls was set back to 0, as that of a topic is which was made anew: what it shows then is counted on top.

      iex> alias Ganglion.Demo.Counter
      iex> counter = Counter.start(100, 0) |> Counter.reach(130, 1_000_000_000) |> Counter.reach(5, 2_000_000_000)
      iex> counter.count
      35
  """

  @enforce_keys [:count, :number, :first, :last, :look]
  defstruct [:count, :number, :first, :last, :look]

  @typedoc "`count` so far; `number` as last read; `first`, `last` and `look` are the count and the time then."
  @type t :: %__MODULE__{
          count: non_neg_integer(),
          number: non_neg_integer(),
          first: mark(),
          last: mark(),
          look: mark()
        }
  @type mark :: {non_neg_integer(), integer()}

  @doc "Nothing counted yet; a number that is there already does not count."
  @spec start(non_neg_integer(), integer()) :: t()
  def start(number, now), do: new(0, number, now)

  @doc "Counts one more."
  @spec hit(t() | nil, integer()) :: t()
  def hit(nil, now), do: new(1, 1, now)
  def hit(counter, now), do: reach(counter, counter.number + 1, now)

  @doc "Counts up to the number as it is read now. A first number counts whole."
  @spec reach(t() | nil, non_neg_integer(), integer()) :: t()
  def reach(nil, number, now), do: new(number, number, now)

  def reach(%{number: before} = counter, number, now) do
    count = counter.count + if(number >= before, do: number - before, else: number)
    %{counter | count: count, number: number, last: {count, now}}
  end

  @doc "Takes a look: `rate/1` counts from here."
  @spec look(t()) :: t()
  def look(counter), do: %{counter | look: counter.last}

  @doc "Per second since the last look."
  @spec rate(t()) :: float()
  def rate(%{look: look, last: last}), do: per_second(look, last)

  @doc "Per second from the first to the last."
  @spec mean_rate(t()) :: float()
  def mean_rate(%{first: first, last: last}), do: per_second(first, last)

  @doc "Nanoseconds since the last one."
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
