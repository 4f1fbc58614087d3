defmodule BB.Loop do
  @moduledoc """
  A timer that ticks at a fixed rate without drift.

  Use it in a process that samples at a rate, such as a controller. A polled sensor has one
  already (`BB.Sensor.Polled`). The process arms the loop and receives `:tick`:

      def init(opts) do
        loop = BB.Loop.new(opts[:bb], clock: {:rate, ~u(100 hertz)}) |> BB.Loop.arm()
        {:ok, %{loop: loop}}
      end

      def handle_info(:tick, state) do
        {dt_seconds, skipped, loop} = BB.Loop.tick(state.loop)
        …
        {:noreply, %{state | loop: loop}}
      end

  Deadlines are absolute and kept in nanoseconds: tick n is due n periods after `arm/1`, however
  late earlier ticks were handled. A handler that takes longer than a period does not get a burst
  of ticks afterwards: the missed ones are skipped and counted.

  The runtime's timers have a resolution of one millisecond. A tick arrives up to a millisecond
  after its deadline, never before it, and above 1 kHz some ticks are skipped. In a test, a robot
  may have a clock that the test advances (`BB.Clock.Stepped`).

  With `clock: :external` the loop sends no ticks. It measures and counts ticks from another
  origin, such as an interrupt or the messages of another sensor: call `tick/1` when one arrives,
  or `observe/2` when its time is known.

  Each tick emits the telemetry event `[:bb, :loop, :tick]` with the measurements `:dt_ns` (`nil`
  at the first tick), `:late_ns` and `:skipped`, and the metadata `:robot` and `:path`.

  ## Fields

    * `:bb` - the owner, `%{robot: robot, path: path}`
    * `:clock` - the clock given to `new/2`
    * `:period_ns` - the period; `nil` with an external clock
    * `:deadline_ns` - the time of the next tick, in monotonic time; `nil` when not armed
    * `:last_ns` - the time of the last tick
    * `:tick_ref` - the timer; `nil` when not armed
    * `:ticks`, `:skipped` - the number of ticks, and of missed ones, since `new/2`
  """

  alias BB.{Clock, Message, Telemetry, Unit}

  @enforce_keys [:bb, :clock]
  defstruct [:bb, :clock, :period_ns, :deadline_ns, :last_ns, :tick_ref, ticks: 0, skipped: 0]

  @type clock :: {:rate, Unit.t() | number()} | :external

  @type t :: %__MODULE__{
          bb: %{robot: module(), path: [atom()]},
          clock: clock(),
          period_ns: pos_integer() | nil,
          deadline_ns: integer() | nil,
          last_ns: integer() | nil,
          tick_ref: Clock.timer() | nil,
          ticks: non_neg_integer(),
          skipped: non_neg_integer()
        }

  @doc """
  Creates a loop that is not armed.

  The rate is a quantity such as `~u(100 hertz)`, or a number of hertz, above zero. Anything else
  raises `ArgumentError`.

      iex> BB.Loop.new(%{robot: MyRobot, path: [:sensor, :imu]}, clock: {:rate, 100}).period_ns
      10000000
  """
  @spec new(%{robot: module(), path: [atom()]}, clock: clock()) :: t()
  def new(bb, opts) do
    case Keyword.validate!(opts, [:clock]) do
      [clock: clock] -> %__MODULE__{bb: bb, clock: clock, period_ns: period_ns(clock)}
      [] -> raise ArgumentError, "expected clock: {:rate, hertz} or clock: :external, got: []"
    end
  end

  defp period_ns(:external), do: nil

  defp period_ns({:rate, hertz}) when is_number(hertz) and hertz > 0,
    do: max(round(1_000_000_000 / hertz), 1)

  defp period_ns({:rate, %Unit{} = rate} = clock) do
    case Unit.convert(rate, :hertz) do
      {:ok, %Unit{value: hertz}} when hertz > 0 -> period_ns({:rate, hertz})
      _ -> raise_clock(clock)
    end
  end

  defp period_ns(clock), do: raise_clock(clock)

  defp raise_clock(clock) do
    raise ArgumentError,
          "expected :external or {:rate, hertz} as clock, with a number above zero or a " <>
            "frequency such as ~u(100 hertz), got: #{inspect(clock)}"
  end

  @doc """
  Arms the loop: the calling process gets `:tick` after one period.

  The process gets further ticks as long as it calls `tick/1` for each. A loop that is armed
  already or has an external clock does not change.
  """
  @spec arm(t()) :: t()
  def arm(%__MODULE__{period_ns: period_ns, tick_ref: nil} = loop) when is_integer(period_ns),
    do: arm_for(loop, now_ns(loop) + period_ns)

  def arm(%__MODULE__{} = loop), do: loop

  @doc """
  Handles a tick and arms the next one. Returns `{dt_seconds, skipped, loop}`.

  `dt_seconds` is the time since the last tick, `nil` at the first one. `skipped` is the number of
  deadlines missed since then.
  """
  @spec tick(t()) :: {float() | nil, non_neg_integer(), t()}
  def tick(%__MODULE__{} = loop), do: observe(loop, now_ns(loop))

  @doc """
  Handles a tick as `tick/1` does, for a tick at a known time.

  The time is a monotonic time in nanoseconds, or the `monotonic_time` of the given message.
  """
  @spec observe(t(), integer() | Message.t()) :: {float() | nil, non_neg_integer(), t()}
  def observe(%__MODULE__{} = loop, %Message{monotonic_time: time_ns}), do: observe(loop, time_ns)

  def observe(%__MODULE__{} = loop, time_ns) when is_integer(time_ns) do
    dt_ns = loop.last_ns && time_ns - loop.last_ns
    skipped = missed(loop, time_ns)
    emit(loop, dt_ns, skipped, time_ns)

    loop =
      %{loop | last_ns: time_ns, ticks: loop.ticks + 1, skipped: loop.skipped + skipped}
      |> advance(time_ns, skipped)

    {dt_ns && dt_ns / 1_000_000_000, skipped, loop}
  end

  @doc "Stops the ticks, and removes one that is in the mailbox already."
  @spec cancel(t()) :: t()
  def cancel(%__MODULE__{tick_ref: nil} = loop), do: loop

  def cancel(%__MODULE__{tick_ref: ref} = loop) do
    :ok = loop |> clock() |> Clock.recall(ref, :tick)
    %{loop | tick_ref: nil, deadline_ns: nil}
  end

  # A tick before its deadline misses none, and the armed tick still arrives.

  defp missed(%{deadline_ns: nil}, _time_ns), do: 0

  defp missed(%{deadline_ns: deadline_ns, period_ns: period_ns}, time_ns),
    do: max(div(time_ns - deadline_ns, period_ns), 0)

  defp advance(%{deadline_ns: nil} = loop, _time_ns, _skipped), do: loop

  defp advance(%{deadline_ns: deadline_ns} = loop, time_ns, _skipped) when time_ns < deadline_ns,
    do: loop

  defp advance(loop, _time_ns, skipped),
    do: arm_for(loop, loop.deadline_ns + (skipped + 1) * loop.period_ns)

  defp arm_for(loop, deadline_ns) do
    ref = loop |> clock() |> Clock.send_at(deadline_ns, self(), :tick)
    %{loop | deadline_ns: deadline_ns, tick_ref: ref}
  end

  defp emit(loop, dt_ns, skipped, time_ns) do
    late_ns = if loop.deadline_ns, do: time_ns - loop.deadline_ns, else: 0

    Telemetry.emit(
      [:bb, :loop, :tick],
      %{dt_ns: dt_ns, late_ns: late_ns, skipped: skipped},
      %{robot: loop.bb.robot, path: loop.bb.path},
      apart: true
    )
  end

  defp now_ns(loop), do: loop |> clock() |> Clock.now_ns()

  defp clock(loop), do: Clock.of(loop.bb.robot)
end
