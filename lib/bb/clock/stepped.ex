defmodule BB.Clock.Stepped do
  @moduledoc """
  A clock that stands still until a test advances it.

  Use it in tests of loops and simulated devices: a minute passes in a moment, and every run is
  the same.

      iex> {:ok, _pid} = BB.Clock.Stepped.start_link(robot: SteppedRobot)
      iex> clock = BB.Clock.of(SteppedRobot)
      iex> start_ns = BB.Clock.now_ns(clock)
      iex> BB.Clock.Stepped.advance(SteppedRobot, 60_000_000_000)
      :ok
      iex> BB.Clock.now_ns(clock) - start_ns
      60000000000

  Start it before the robot, whose loops get it from `BB.Clock.of/1`. Give a simulated bus the
  same clock: `BB.Bus.Sim.start_link(buses: %{"i2c-1" => [devices: devices, clock: clock]})`.
  Everything else uses the machine's time: waits in a driver's `init`, restarts, `max_silence`,
  and the timestamps of messages.

  Messages that are due are sent one after the other in the order of their times. Before the clock
  sends the next message, it waits until the receiver has handled the last one.
  """
  use GenServer
  use BB.Process.Tolerant

  @enforce_keys [:now, :timers]
  defstruct [:now, :timers]

  @type t :: %__MODULE__{now: :atomics.atomics_ref(), timers: :ets.table()}

  @typedoc "A scheduled message: its time, and its order among those of the same time."
  @type timer :: {time_ns :: integer(), order :: integer()}

  @idle_timeout_ms 60_000

  @doc """
  Starts a clock for the robot `robot:` at the machine's time, linked to the caller.

  When it ends, the robot has the machine's clock again.
  """
  @spec start_link(robot: module()) :: GenServer.on_start()
  def start_link(opts) do
    [robot: robot] = Keyword.validate!(opts, [:robot])
    GenServer.start_link(__MODULE__, robot)
  end

  @doc """
  Advances a robot's clock by `duration_ns` nanoseconds.

  Returns when the receivers have handled every message that was due. The option `settle:` lists
  further processes to wait for, before the first message and after each, in the order given:
  those that get messages from processes other than the clock.

  Raises `ArgumentError` when the robot's clock is not a stepped one. A receiver that does not
  answer within #{div(@idle_timeout_ms, 1000)} s makes the caller exit as a call of `:sys` does.
  """
  @spec advance(module(), non_neg_integer(), settle: [pid()]) :: :ok
  def advance(robot, duration_ns, opts \\ []) when is_integer(duration_ns) and duration_ns >= 0 do
    [settle: settle] = Keyword.validate!(opts, settle: [])
    clock = stepped!(robot)
    Enum.each(settle, &await_idle/1)
    run_until(clock, now_ns(clock) + duration_ns, settle)
  end

  @doc false
  @spec now_ns(t()) :: integer()
  def now_ns(clock), do: :atomics.get(clock.now, 1)

  @doc false
  @spec send_at(t(), integer(), pid(), term()) :: timer()
  def send_at(clock, time_ns, pid, message) do
    timer = {max(time_ns, now_ns(clock)), System.unique_integer([:monotonic])}
    :ets.insert(clock.timers, {timer, pid, message})
    timer
  end

  @doc false
  @spec cancel(t(), timer()) :: boolean()
  def cancel(clock, timer), do: :ets.take(clock.timers, timer) != []

  defp stepped!(robot) do
    case BB.Clock.of(robot) do
      %__MODULE__{} = clock ->
        clock

      :real ->
        raise ArgumentError,
              "robot #{inspect(robot)} has no stepped clock; start one before the robot"
    end
  end

  defp run_until(clock, until_ns, settle) do
    case :ets.first(clock.timers) do
      {time_ns, _order} = timer when time_ns <= until_ns ->
        set(clock, time_ns)
        clock.timers |> :ets.take(timer) |> deliver(settle)
        run_until(clock, until_ns, settle)

      _none_or_later ->
        set(clock, until_ns)
    end
  end

  defp set(clock, time_ns), do: :atomics.put(clock.now, 1, max(time_ns, now_ns(clock)))

  # The message may have been cancelled at the last moment.
  defp deliver([], _settle), do: :ok

  defp deliver([{_timer, pid, message}], settle) do
    send(pid, message)
    Enum.each([pid | settle], &await_idle/1)
  end

  # A process that answers has handled everything that it got before.
  defp await_idle(pid) do
    :sys.statistics(pid, :get, @idle_timeout_ms)
  catch
    :exit, {reason, _call} when reason != :timeout -> :gone
  end

  @impl GenServer
  def init(robot) do
    Process.flag(:trap_exit, true)

    clock = %__MODULE__{
      now: :atomics.new(1, signed: true),
      timers: :ets.new(__MODULE__, [:ordered_set, :public])
    }

    set_start(clock)
    :persistent_term.put({BB.Clock, robot}, clock)
    {:ok, {robot, clock}}
  end

  defp set_start(clock), do: :atomics.put(clock.now, 1, System.monotonic_time(:nanosecond))

  # The clock of a successor stays in place.
  @impl GenServer
  def terminate(_reason, {robot, clock}) do
    if BB.Clock.of(robot) == clock, do: :persistent_term.erase({BB.Clock, robot})
  end
end
