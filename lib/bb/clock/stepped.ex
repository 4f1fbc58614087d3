defmodule BB.Clock.Stepped do
  @moduledoc """
  A clock that stands still until it is stepped: a minute of a robot's life in a moment, and the same each time.

      {:ok, _} = BB.Clock.Stepped.start_link(robot: MyRobot)
      {:ok, _} = BB.Bus.Sim.start_link(buses: %{"i2c-1" => [devices: devices, clock: BB.Clock.of(MyRobot)]})
      {:ok, _} = MyRobot.start_link()
      …
      :ok = BB.Clock.Stepped.advance(MyRobot, 60_000_000_000)

  It must be started before the robot, whose loops take it from `BB.Clock.of/1`. What is not a loop keeps the machine's time: the
  waits of a driver's `init`, restarts, `max_silence`, and the stamps of messages.

  Messages that are due are sent one after the other in the order of their times, each to a process that has nothing else to do: a
  step waits until the receiver of one has handled it before it sends the next.
  """
  use GenServer
  use BB.Process.Tolerant

  @enforce_keys [:now, :timers]
  defstruct [:now, :timers]

  @type t :: %__MODULE__{now: :atomics.atomics_ref(), timers: :ets.table()}

  @typedoc "A message to come: its time, and its place among those of the same time."
  @type timer :: {time_ns :: integer(), order :: integer()}

  @settle_ms 60_000

  @doc "Starts a clock for `robot:`, at the machine's time, linked to the caller. The robot has the machine's again when it ends."
  @spec start_link(robot: module()) :: GenServer.on_start()
  def start_link(opts) do
    [robot: robot] = Keyword.validate!(opts, [:robot])
    GenServer.start_link(__MODULE__, robot)
  end

  @doc """
  Lets `duration_ns` nanoseconds pass for a robot, and returns when everything that was due has been handled.

  `settle:` names processes that are waited for too, before the first message and after each, in their order: those that get messages from others than
  the clock.

  Raises `ArgumentError` when the robot's clock is real. A receiver that does not come back within #{div(@settle_ms, 1000)} s ends the caller
  with the exit of `:sys.get_state/1`.
  """
  @spec advance(module(), non_neg_integer(), settle: [pid()]) :: :ok
  def advance(robot, duration_ns, opts \\ []) when is_integer(duration_ns) and duration_ns >= 0 do
    [settle: settle] = Keyword.validate!(opts, settle: [])
    clock = stepped!(robot)
    Enum.each(settle, &settle/1)
    run(clock, now_ns(clock) + duration_ns, settle)
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
      %__MODULE__{} = clock -> clock
      :real -> raise ArgumentError, "#{inspect(robot)} has no stepped clock: start one before it"
    end
  end

  defp run(clock, until_ns, settle) do
    case :ets.first(clock.timers) do
      {time_ns, _order} = timer when time_ns <= until_ns ->
        set(clock, time_ns)
        clock.timers |> :ets.take(timer) |> deliver(settle)
        run(clock, until_ns, settle)

      _none_or_later ->
        set(clock, until_ns)
    end
  end

  defp set(clock, time_ns), do: :atomics.put(clock.now, 1, max(time_ns, now_ns(clock)))

  # Somebody may have taken it back at the last moment.
  defp deliver([], _settle), do: :ok

  defp deliver([{_timer, pid, message}], settle) do
    send(pid, message)
    Enum.each([pid | settle], &settle/1)
  end

  # Whatever it got before, it has handled when it answers.
  defp settle(pid) do
    :sys.statistics(pid, :get, @settle_ms)
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

  # A successor's clock stays.
  @impl GenServer
  def terminate(_reason, {robot, clock}) do
    if BB.Clock.of(robot) == clock, do: :persistent_term.erase({BB.Clock, robot})
  end
end
