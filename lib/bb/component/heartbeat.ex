defmodule BB.Component.Heartbeat do
  @moduledoc """
  The numbers that a component and its keeper share without a message: the component's last
  heartbeat, its `max_silence` and the limit of its `terminate/2`.

  Drivers use it by `BB.Sensor.beat/1`, `BB.Sensor.max_silence_ns/0` and
  `BB.Sensor.shut_down_within/1`. The numbers are in `:atomics`, so that either process reads them
  even while the other one hangs.

      iex> alias BB.Component.Heartbeat
      iex> heartbeat = Heartbeat.new(250_000_000)
      iex> Heartbeat.adopt(heartbeat)
      iex> Heartbeat.beat(1_000)
      iex> {Heartbeat.last_ns(heartbeat), Heartbeat.max_silence_ns()}
      {1_000, 250_000_000}

  The keeper makes a heartbeat for each process that it starts, and that process adopts it
  (`adopt/1`). In a process without one, as in a driver's test, `beat/1` and `shut_down_within/1`
  do nothing.
  """

  @last 1
  @max_silence 2
  @shutdown 3

  @never -0x8000_0000_0000_0000
  @shutdown_ms 5_000

  @opaque t :: :atomics.atomics_ref()

  @doc "Returns a new heartbeat of a component with this `max_silence`, or with none for `nil`."
  @spec new(pos_integer() | nil) :: t()
  def new(max_silence_ns) do
    heartbeat = :atomics.new(3, signed: true)
    :atomics.put(heartbeat, @last, @never)
    :atomics.put(heartbeat, @max_silence, max_silence_ns || 0)
    :atomics.put(heartbeat, @shutdown, @shutdown_ms)
    heartbeat
  end

  @doc "Makes a heartbeat the calling process's own."
  @spec adopt(t() | nil) :: :ok
  def adopt(heartbeat) do
    _ = if heartbeat, do: Process.put(__MODULE__, heartbeat)
    :ok
  end

  @doc "Records that the calling component was well at a monotonic time in nanoseconds."
  @spec beat(integer()) :: :ok
  def beat(time_ns) do
    if heartbeat = own(), do: :atomics.put(heartbeat, @last, time_ns)
    :ok
  end

  @doc """
  Sets the time that the calling component's `terminate/2` may take. The default is
  #{@shutdown_ms} ms.
  """
  @spec shut_down_within(non_neg_integer()) :: :ok
  def shut_down_within(ms) do
    if heartbeat = own(), do: :atomics.put(heartbeat, @shutdown, ms)
    :ok
  end

  @doc "Returns the calling component's `max_silence` in nanoseconds, or `nil` when it has none."
  @spec max_silence_ns() :: pos_integer() | nil
  def max_silence_ns do
    case own() && :atomics.get(own(), @max_silence) do
      0 -> nil
      max_silence_ns -> max_silence_ns
    end
  end

  @doc "Returns the time of the last beat, or `nil` before the first."
  @spec last_ns(t()) :: integer() | nil
  def last_ns(heartbeat) do
    last_ns = :atomics.get(heartbeat, @last)
    if last_ns != @never, do: last_ns
  end

  @doc "Returns the default limit of `terminate/2` in milliseconds."
  @spec default_shutdown_ms() :: pos_integer()
  def default_shutdown_ms, do: @shutdown_ms

  @doc "Returns the limit of the component's `terminate/2` in milliseconds."
  @spec shutdown_ms(t()) :: non_neg_integer()
  def shutdown_ms(heartbeat), do: :atomics.get(heartbeat, @shutdown)

  defp own, do: Process.get(__MODULE__)
end
