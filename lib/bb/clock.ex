defmodule BB.Clock do
  @moduledoc """
  The time that a robot's loops and its simulated hardware go by: that of the machine, or one that a test steps
  (`BB.Clock.Stepped`).

      clock = BB.Clock.of(robot)
      timer = BB.Clock.send_at(clock, BB.Clock.now_ns(clock) + 10_000_000, self(), :due)

  Times are nanoseconds of one monotonic clock; only differences mean something.
  """
  alias BB.Clock.Stepped

  @typedoc "A clock. Anyone may use it, from any process."
  @type t :: :real | Stepped.t()

  @typedoc "A message to come."
  @opaque timer :: reference() | Stepped.timer()

  @doc "The robot's clock: `:real` unless a `BB.Clock.Stepped` was started for it."
  @spec of(module()) :: t()
  def of(robot), do: :persistent_term.get({__MODULE__, robot}, :real)

  @doc "The time now."
  @spec now_ns(t()) :: integer()
  def now_ns(:real), do: System.monotonic_time(:nanosecond)
  def now_ns(%Stepped{} = clock), do: Stepped.now_ns(clock)

  @doc """
  Sends `message` to `pid` at a time, or at once if that has passed.

  The machine's timers have a resolution of one millisecond: a message comes up to that much after its time, never before it.
  """
  @spec send_at(t(), integer(), pid(), term()) :: timer()
  def send_at(:real, time_ns, pid, message),
    do: :erlang.send_after(ceil_ms(time_ns), pid, message, abs: true)

  def send_at(%Stepped{} = clock, time_ns, pid, message),
    do: Stepped.send_at(clock, time_ns, pid, message)

  @doc "Takes a message back: whether it was still to come."
  @spec cancel(t(), timer()) :: boolean()
  def cancel(:real, timer), do: :erlang.cancel_timer(timer) != false
  def cancel(%Stepped{} = clock, timer), do: Stepped.cancel(clock, timer)

  @doc "Takes a message to the calling process back, out of its mailbox too where it has come already."
  @spec recall(t(), timer(), term()) :: :ok
  def recall(clock, timer, message) do
    if not cancel(clock, timer) do
      receive do
        ^message -> :ok
      after
        0 -> :ok
      end
    end

    :ok
  end

  defp ceil_ms(time_ns), do: -Integer.floor_div(-time_ns, 1_000_000)
end
