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

  Deadlines are absolute and kept in nanoseconds: they are whole periods after `new/2`, however
  late earlier ticks were handled. A handler that takes longer than a period does not get a burst
  of ticks afterwards: the missed ones are skipped and counted, so that `ticks + skipped` is the
  number of periods that have passed.

  Each call of `tick/1` arms the next tick. A process that does not arm the loop, but sends itself
  the first `:tick`, keeps ticking at the rate too.

  The runtime's timers have a resolution of one millisecond. A tick arrives up to a millisecond
  after its deadline, never before it, and above 1 kHz some ticks are skipped. In a test, a robot
  may have a clock that the test advances (`BB.Clock.Stepped`).

  With `clock: :external` the loop sends no ticks. It measures and counts ticks from another
  origin, such as an interrupt or the messages of another sensor: call `observe/2` with the time
  of each.

  ## Telemetry

  Each tick but the first emits the event `[:bb, :loop, :tick]` with the measurements

    * `:dt` - the time since the last tick, in seconds
    * `:skipped` - the number of periods that this tick skipped
    * `:deadline_error` - the time between the tick and its deadline, in nanoseconds

  and the metadata `:robot`, `:path` and `:clock`.

  ## Fields

    * `:bb` - the owner, `%{robot: robot, path: path}`
    * `:clock` - `{:rate, hertz}` with a float, or `:external`
    * `:period_ns` - the period; `nil` with an external clock
    * `:deadline_ns` - the last deadline that was set, in monotonic time; the time of `new/2` at
      first
    * `:last_ns` - the time of the last tick
    * `:tick_ref` - the timer; `nil` when not armed
    * `:ticks`, `:skipped` - the number of ticks, and of missed ones, since `new/2`
  """

  alias BB.{Clock, Message, Telemetry, Unit}

  @enforce_keys [:bb, :clock]
  defstruct [:bb, :clock, :period_ns, :deadline_ns, :last_ns, :tick_ref, ticks: 0, skipped: 0]

  @type t :: %__MODULE__{
          bb: %{robot: module(), path: [atom()]},
          clock: {:rate, float()} | :external,
          period_ns: pos_integer() | nil,
          deadline_ns: integer(),
          last_ns: integer() | nil,
          tick_ref: Clock.timer() | nil,
          ticks: non_neg_integer(),
          skipped: non_neg_integer()
        }

  @doc """
  Creates a loop that is not armed.

  The rate is a quantity such as `~u(100 hertz)`, or a number of hertz, above zero.

      iex> loop = BB.Loop.new(%{robot: MyRobot, path: [:sensor, :imu]}, clock: {:rate, 100})
      iex> {loop.clock, loop.period_ns}
      {{:rate, 100.0}, 10_000_000}

  Raises `KeyError` without `clock:`, `FunctionClauseError` for an owner without `:robot` and
  `:path` and for a rate that is not above zero, and `ArgumentError` for any other clock.
  """
  @spec new(%{robot: module(), path: [atom()]},
          clock: {:rate, Unit.t() | number()} | :external
        ) :: t()
  def new(%{robot: robot, path: _path} = bb, opts) do
    clock = opts |> Keyword.fetch!(:clock) |> normalise()

    %__MODULE__{
      bb: bb,
      clock: clock,
      period_ns: period_ns(clock),
      deadline_ns: robot |> Clock.of() |> Clock.now_ns()
    }
  end

  defp normalise(:external), do: :external

  defp normalise({:rate, %Unit{} = rate} = clock) do
    case Unit.convert(rate, :hertz) do
      {:ok, %Unit{value: hertz}} -> rate_clock(hertz)
      {:error, _error} -> raise_clock(clock)
    end
  end

  defp normalise({:rate, hertz}) when is_number(hertz), do: rate_clock(hertz)
  defp normalise(clock), do: raise_clock(clock)

  defp rate_clock(hertz) when hertz > 0, do: {:rate, hertz / 1}

  defp raise_clock(clock) do
    raise ArgumentError,
          "expected :external or {:rate, hertz} as clock, with a number above zero or a " <>
            "frequency such as ~u(100 hertz), got: #{inspect(clock)}"
  end

  defp period_ns(:external), do: nil
  defp period_ns({:rate, hertz}), do: max(round(1_000_000_000 / hertz), 1)

  @doc """
  Arms the loop: the calling process gets `:tick` at the next deadline.

  The process gets further ticks as long as it calls `tick/1` for each. A loop that is armed
  already or has an external clock does not change. A loop that was cancelled continues with its
  deadlines from before; the periods between are not counted as skipped.
  """
  @spec arm(t()) :: t()
  def arm(%__MODULE__{clock: {:rate, _hertz}, tick_ref: nil} = loop) do
    {periods, _skipped} = next_deadline(loop, now_ns(loop))
    schedule(loop, periods)
  end

  def arm(%__MODULE__{} = loop), do: loop

  @doc """
  Handles a tick and arms the next one. Returns `{dt_seconds, skipped, loop}`.

  `dt_seconds` is the time since the last tick, `nil` at the first one. `skipped` is the number of
  periods that were missed since its deadline. A tick that comes before its deadline, because the
  process has sent it to itself, takes the place of the one that is armed.

  With an external clock, the tick is observed now (`observe/2`).
  """
  @spec tick(t()) :: {float() | nil, non_neg_integer(), t()}
  def tick(%__MODULE__{clock: :external} = loop), do: observe(loop, now_ns(loop))

  def tick(%__MODULE__{} = loop) do
    now_ns = now_ns(loop)
    {periods, skipped} = next_deadline(loop, now_ns)
    next = loop |> withdraw_early(now_ns) |> schedule(periods)
    measure(next, now_ns, skipped, now_ns - loop.deadline_ns)
  end

  @doc """
  Measures a tick of an external clock. Returns as `tick/1` does, with nothing skipped.

  The time is a monotonic time in nanoseconds, or the `monotonic_time` of the given message. A
  time that is not after the last one is not counted: the loop does not change, so that the next
  good one is measured from the last good one.

      iex> loop = BB.Loop.new(%{robot: MyRobot, path: [:filter]}, clock: :external)
      iex> {nil, 0, loop} = BB.Loop.observe(loop, 1_000_000)
      iex> {0.002, 0, loop} = BB.Loop.observe(loop, 3_000_000)
      iex> BB.Loop.observe(loop, 2_000_000) == {nil, 0, loop}
      true
  """
  @spec observe(t(), integer() | Message.t()) :: {float() | nil, 0, t()}
  def observe(%__MODULE__{} = loop, %Message{monotonic_time: time_ns}), do: observe(loop, time_ns)

  def observe(%__MODULE__{last_ns: last_ns} = loop, time_ns)
      when is_integer(time_ns) and is_integer(last_ns) and time_ns <= last_ns,
      do: {nil, 0, loop}

  def observe(%__MODULE__{} = loop, time_ns) when is_integer(time_ns),
    do: measure(loop, time_ns, 0, 0)

  @doc """
  Stops the ticks, and removes one that is in the mailbox already.

  A loop that is not armed does not change.
  """
  @spec cancel(t()) :: t()
  def cancel(%__MODULE__{tick_ref: nil} = loop), do: loop

  def cancel(%__MODULE__{tick_ref: ref} = loop) do
    :ok = loop |> clock() |> Clock.recall(ref, :tick)
    %{loop | tick_ref: nil}
  end

  # How many periods after its last deadline the loop has its next one, and how many deadlines
  # between have passed. A deadline that early ticks and repeated arming have moved ahead comes
  # back: the next one is at most two periods from now.
  defp next_deadline(loop, now_ns) do
    case Integer.floor_div(now_ns - loop.deadline_ns, loop.period_ns) do
      passed when passed >= 0 -> {passed + 1, passed}
      -1 -> {1, 0}
      ahead -> {ahead + 2, 0}
    end
  end

  defp schedule(loop, periods) do
    deadline_ns = loop.deadline_ns + periods * loop.period_ns
    ref = loop |> clock() |> Clock.send_at(deadline_ns, self(), :tick)
    %{loop | deadline_ns: deadline_ns, tick_ref: ref}
  end

  # Otherwise the loop would send two ticks in a period from now on.
  defp withdraw_early(%{tick_ref: ref} = loop, now_ns)
       when ref != nil and now_ns < loop.deadline_ns do
    _ = loop |> clock() |> Clock.cancel(ref)
    loop
  end

  defp withdraw_early(loop, _now_ns), do: loop

  defp measure(loop, time_ns, skipped, deadline_error_ns) do
    dt = loop.last_ns && (time_ns - loop.last_ns) / 1_000_000_000
    emit(loop, dt, skipped, deadline_error_ns)

    loop = %{
      loop
      | last_ns: time_ns,
        ticks: loop.ticks + 1,
        skipped: loop.skipped + skipped
    }

    {dt, skipped, loop}
  end

  defp emit(_loop, nil, _skipped, _deadline_error_ns), do: :ok

  defp emit(loop, dt, skipped, deadline_error_ns) do
    Telemetry.emit(
      [:bb, :loop, :tick],
      %{dt: dt, skipped: skipped, deadline_error: deadline_error_ns},
      %{robot: loop.bb.robot, path: loop.bb.path, clock: loop.clock},
      apart: true
    )
  end

  defp now_ns(loop), do: loop |> clock() |> Clock.now_ns()

  defp clock(loop), do: Clock.of(loop.bb.robot)
end
