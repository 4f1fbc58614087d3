defmodule BB.Clock do
  @moduledoc """
  The clock of a robot: the machine's, or one that a test steps (`BB.Clock.Stepped`).

  A robot's loops and its simulated hardware use it, so that a test can control their time. Code
  that waits or schedules on a robot's behalf uses it too:

      iex> clock = BB.Clock.of(DocRobot)
      iex> _timer = BB.Clock.send_at(clock, BB.Clock.now_ns(clock) + 2_000_000, self(), :due)
      iex> receive do :due -> :ok end
      :ok

  Times are nanoseconds of a monotonic clock; only their differences have a meaning.
  """
  alias BB.Clock.Stepped

  @typedoc "A clock, which every process may use."
  @type t :: :real | Stepped.t()

  @typedoc "A message that is scheduled."
  @opaque timer :: reference() | Stepped.timer()

  @doc "Returns the robot's clock: `:real` unless a `BB.Clock.Stepped` was started for it."
  @spec of(module()) :: t()
  def of(robot), do: :persistent_term.get({__MODULE__, robot}, :real)

  @doc "Returns the time now."
  @spec now_ns(t()) :: integer()
  def now_ns(:real), do: System.monotonic_time(:nanosecond)
  def now_ns(%Stepped{} = clock), do: Stepped.now_ns(clock)

  @doc """
  Sends `message` to `pid` at the given time, or at once if that has passed.

  The machine's timers have a resolution of one millisecond: a message is sent up to a millisecond
  after its time, never before it.
  """
  @spec send_at(t(), integer(), pid(), term()) :: timer()
  def send_at(:real, time_ns, pid, message),
    do: :erlang.send_after(ceil_ms(time_ns), pid, message, abs: true)

  def send_at(%Stepped{} = clock, time_ns, pid, message),
    do: Stepped.send_at(clock, time_ns, pid, message)

  @doc "Cancels a message. Returns whether it had not been sent yet."
  @spec cancel(t(), timer()) :: boolean()
  def cancel(:real, timer), do: :erlang.cancel_timer(timer) != false
  def cancel(%Stepped{} = clock, timer), do: Stepped.cancel(clock, timer)

  @doc """
  Cancels a message to the calling process, and removes it from its mailbox if it was sent
  already.
  """
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
