defmodule BB.Loop do
  @moduledoc """
  Ticks at a set rate, without drift.

  A process that samples at a rate arms a loop and is sent `:tick`:

      def init(opts) do
        loop = BB.Loop.new(opts[:bb], clock: {:rate, ~u(100 hertz)}) |> BB.Loop.arm()
        {:ok, %{loop: loop}}
      end

      def handle_info(:tick, state) do
        {dt_seconds, skipped, loop} = BB.Loop.tick(state.loop)
        …
        {:noreply, %{state | loop: loop}}
      end

  Deadlines are absolute and kept in nanoseconds: tick n is due n periods after `arm/1`, however late the ticks before it
  were handled. A handler that takes longer than a period is not sent ticks in a burst: what it missed is skipped and counted.

  The runtime's timers have a resolution of one millisecond. A tick comes up to that much after its deadline, never before
  it, and above 1 kHz some are skipped. A robot in a test may have a clock that is stepped (`BB.Clock.Stepped`).

  With `clock: :external` nothing is sent; the loop measures and counts ticks that come from elsewhere, an interrupt or another
  sensor's messages: call `tick/1` when one comes, or `observe/2` when it is known at what time it was.

  Each tick emits the telemetry event `[:bb, :loop, :tick]` with the measurements `:dt_ns` (`nil` at the first), `:late_ns` and
  `:skipped`, and the metadata `:robot` and `:path`.

  ## Fields

    * `:bb` - whose loop it is, `%{robot: R, path: path}`
    * `:clock` - as given
    * `:period_ns` - `nil` with an external clock
    * `:deadline_ns` - when the next tick is due, in monotonic time; `nil` when not armed
    * `:last_ns` - when the last tick was
    * `:tick_ref` - the timer; `nil` when not armed
    * `:ticks`, `:skipped` - how many there were, and how many were missed, since `new/2`
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
  A loop that is not armed yet.

  The rate is a quantity such as `~u(100 hertz)`, or a number of hertz, above zero. Anything else raises `ArgumentError`.
  """
  @spec new(%{robot: module(), path: [atom()]}, clock: clock()) :: t()
  def new(bb, opts) do
    case Keyword.validate!(opts, [:clock]) do
      [clock: clock] -> %__MODULE__{bb: bb, clock: clock, period_ns: period_ns(clock)}
      [] -> raise ArgumentError, "a loop needs clock: {:rate, hertz} or clock: :external"
    end
  end

  defp period_ns(:external), do: nil

  defp period_ns({:rate, hertz}) when is_number(hertz) and hertz > 0,
    do: max(round(1_000_000_000 / hertz), 1)

  defp period_ns({:rate, %Unit{} = rate} = clock) do
    case Unit.convert(rate, :hertz) do
      {:ok, %Unit{value: hertz}} when hertz > 0 -> period_ns({:rate, hertz})
      _ -> refuse(clock)
    end
  end

  defp period_ns(clock), do: refuse(clock)

  defp refuse(clock) do
    raise ArgumentError,
          "expected a clock of {:rate, hertz}, with a number above zero or a frequency such as ~u(100 hertz), " <>
            "or :external, got: #{inspect(clock)}"
  end

  @doc """
  Sends the calling process `:tick` after a period, and after each period from then on while `tick/1` is called for each.

  A loop that is armed already stays as it is, and so does one with an external clock.
  """
  @spec arm(t()) :: t()
  def arm(%__MODULE__{period_ns: period_ns, tick_ref: nil} = loop) when is_integer(period_ns),
    do: arm_for(loop, now_ns(loop) + period_ns)

  def arm(%__MODULE__{} = loop), do: loop

  @doc """
  Takes a tick: `{dt_seconds, skipped, loop}`.

  `dt_seconds` is the time since the last tick, `nil` at the first; `skipped` is how many deadlines were missed since then.
  The next tick is armed.
  """
  @spec tick(t()) :: {float() | nil, non_neg_integer(), t()}
  def tick(%__MODULE__{} = loop), do: observe(loop, now_ns(loop))

  @doc """
  Like `tick/1`, for a tick at a time that is known: a monotonic time in nanoseconds, or a message, whose `monotonic_time`
  counts.
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

  @doc "Stops the ticks. One that is in the mailbox already is taken out of it."
  @spec cancel(t()) :: t()
  def cancel(%__MODULE__{tick_ref: nil} = loop), do: loop

  def cancel(%__MODULE__{tick_ref: ref} = loop) do
    :ok = loop |> clock() |> Clock.recall(ref, :tick)
    %{loop | tick_ref: nil, deadline_ns: nil}
  end

  # Before its deadline a tick misses nothing, and the one that is armed still comes.

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
