defmodule BB.Component.Heartbeat do
  @moduledoc """
  What a component and its keeper tell each other without a message: a few numbers that either may
  read at any time, also while the other hangs.

  The keeper makes a heartbeat for each process that it starts. That process makes it its own
  (`adopt/1`), and then any code in it may say

    * that it is well (`beat/1`), where this does not show in messages on the component's path
    * how long its `terminate/2` may take (`shut_down_within/1`)

  In a process without a keeper, a driver's test for one, these do nothing.
  """

  @heard 1
  @max_silence 2
  @shutdown 3

  @never -0x8000_0000_0000_0000
  @shutdown_ms 5_000

  @opaque t :: :atomics.atomics_ref()

  @doc "A new heartbeat, of a component that may be silent for so long, `nil` for ever."
  @spec new(pos_integer() | nil) :: t()
  def new(max_silence_ns) do
    heartbeat = :atomics.new(3, signed: true)
    :atomics.put(heartbeat, @heard, @never)
    :atomics.put(heartbeat, @max_silence, max_silence_ns || 0)
    :atomics.put(heartbeat, @shutdown, @shutdown_ms)
    heartbeat
  end

  @doc "Makes it the calling process's own."
  @spec adopt(t() | nil) :: :ok
  def adopt(heartbeat) do
    _ = if heartbeat, do: Process.put(__MODULE__, heartbeat)
    :ok
  end

  @doc "Says that the calling component was well at a monotonic time in nanoseconds."
  @spec beat(integer()) :: :ok
  def beat(time_ns) do
    if heartbeat = own(), do: :atomics.put(heartbeat, @heard, time_ns)
    :ok
  end

  @doc "Says how long the calling component's `terminate/2` may take; #{@shutdown_ms} ms otherwise."
  @spec shut_down_within(non_neg_integer()) :: :ok
  def shut_down_within(ms) do
    if heartbeat = own(), do: :atomics.put(heartbeat, @shutdown, ms)
    :ok
  end

  @doc "How long the calling component may be silent, as its robot declares; `nil` for ever."
  @spec max_silence_ns() :: pos_integer() | nil
  def max_silence_ns do
    case own() && :atomics.get(own(), @max_silence) do
      0 -> nil
      max_silence_ns -> max_silence_ns
    end
  end

  @doc "When it beat last, `nil` before that."
  @spec heard_ns(t()) :: integer() | nil
  def heard_ns(heartbeat) do
    heard_ns = :atomics.get(heartbeat, @heard)
    if heard_ns != @never, do: heard_ns
  end

  @doc "How long `terminate/2` may take of a component that has not said it."
  @spec default_shutdown_ms() :: pos_integer()
  def default_shutdown_ms, do: @shutdown_ms

  @doc "How long `terminate/2` may take."
  @spec shutdown_ms(t()) :: non_neg_integer()
  def shutdown_ms(heartbeat), do: :atomics.get(heartbeat, @shutdown)

  defp own, do: Process.get(__MODULE__)
end
