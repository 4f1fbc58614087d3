defmodule BB.PubSub.Meter do
  @moduledoc """
  Counts the messages of one stream, a path with a payload type, at two atomic operations a
  message.

  A meter holds the number of messages, the times of the last sixteen, and the version of the
  route that publishers may use. `BB.PubSub.Streams` keeps the meters.

      word = Meter.tick(meter, message.monotonic_time)
      Meter.current?(word, version)

  ## Versions

  The first word of a meter holds the number of messages in its low bits and a version in its high
  bits. A route carries the version for which it was made. The registrar raises the version of a
  stream before it changes the stream's subscribers. So a publisher, which counts its message
  anyway, sees by the resulting word whether its route is outdated, and then looks up the
  subscriptions itself.
  """

  import Bitwise

  @times 16

  # A word has 64 bits, of which the VM stores 60 without a heap allocation: a sign, 14 bits of
  # the version, 44 bits for 17 million million messages.
  @count_bits 44
  @version 1 <<< @count_bits
  @versions 1 <<< 14

  @type t :: :atomics.atomics_ref()

  @doc "Creates a meter that has counted no message."
  @spec new() :: t()
  def new, do: :atomics.new(1 + @times, [])

  @doc "Counts as `count/2` does, for an integer time and without a function call."
  defmacro tick(meter, time) do
    quote do
      word = :atomics.add_get(unquote(meter), 1, 1)
      :atomics.put(unquote(meter), 2 + :erlang.band(word, unquote(@times - 1)), unquote(time))
      word
    end
  end

  @doc """
  Returns whether a route of this version may be used, given the word that `tick/2` returned.
  Expands to an expression without a function call.
  """
  defmacro current?(word, version),
    do: quote(do: :erlang.bsr(unquote(word), unquote(@count_bits)) == unquote(version))

  @doc """
  Counts a message measured at `time`, Erlang monotonic time in nanoseconds. Returns the word for
  `current?/2`.
  """
  @spec count(t(), term()) :: pos_integer()
  def count(meter, time) when is_integer(time), do: tick(meter, time)
  def count(meter, _time), do: count(meter, :erlang.monotonic_time(:nanosecond))

  @doc "Returns the number of messages counted."
  @spec counted(t()) :: non_neg_integer()
  def counted(meter), do: :atomics.get(meter, 1) &&& @version - 1

  @doc "Returns the version of the route that publishers may use."
  @spec version(t()) :: non_neg_integer()
  def version(meter), do: :atomics.get(meter, 1) >>> @count_bits

  @doc "Makes all routes of the stream outdated. Only the registrar calls it."
  @spec outdate(t()) :: :ok
  def outdate(meter) do
    case version(meter) + 1 do
      @versions -> :atomics.sub(meter, 1, (@versions - 1) * @version)
      _ -> :atomics.add(meter, 1, @version)
    end
  end

  @doc "Returns the time of the message counted last. At least one must have been counted."
  @spec newest(t()) :: integer()
  def newest(meter), do: time(meter, counted(meter))

  @doc "Returns the times of the last messages, at most sixteen, newest first, given their count."
  @spec times(t(), pos_integer()) :: [integer(), ...]
  def times(meter, count) do
    times = for n <- count..max(count - @times + 1, 1)//-1, do: time(meter, n)
    Enum.sort(times, :desc)
  end

  defp time(meter, number), do: :atomics.get(meter, 2 + (number &&& @times - 1))

  @doc """
  Returns the rate in Hz of messages with these times, newest first. It falls once the next
  message is overdue.

      iex> BB.PubSub.Meter.rate_hz([3_000_000, 2_000_000, 1_000_000], 3_000_000)
      1000.0
      iex> BB.PubSub.Meter.rate_hz([3_000_000, 2_000_000, 1_000_000], 1_001_000_000)
      3.0
  """
  @spec rate_hz([integer(), ...], integer()) :: float()
  def rate_hz([_only], _now), do: 0.0

  def rate_hz([newest | rest], now) do
    oldest = List.last(rest)
    intervals = length(rest)
    period = (newest - oldest) / intervals

    cond do
      now - newest > period -> (intervals + 1) * 1.0e9 / (now - oldest)
      period > 0 -> 1.0e9 / period
      true -> 0.0
    end
  end
end
