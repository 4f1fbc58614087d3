defmodule BB.Component.Lifecycle do
  @moduledoc """
  The state machine of a component: its phases, its events and the actions of its keeper.

  `BB.Component.Keeper` turns each message into an event, passes it to `transition/3` and carries
  out the actions. The module is pure; times are monotonic nanoseconds.

      iex> alias BB.Component.Lifecycle
      iex> lifecycle = Lifecycle.new(0)
      iex> {%{phase: :starting} = lifecycle, [watch_init: 5_000]} =
      ...>   Lifecycle.transition(lifecycle, :started, 1)
      iex> {%{phase: :running} = lifecycle, [:watch_activity]} =
      ...>   Lifecycle.transition(lifecycle, :up, 2)
      iex> {lifecycle, [retry_after: delay_ms]} =
      ...>   Lifecycle.transition(lifecycle, {:exited, {:crash, :oops}}, 3)
      iex> {lifecycle.phase, lifecycle.status.reason, delay_ms in 50..100}
      {:backoff, :oops, true}

  ## Phases

    * `:starting` - the component's process is being started, or runs `init/1`
    * `:blocked` - an orphan, a process that a killed keeper left behind, still has the name
    * `:running` - `init/1` has returned `{:ok, state}`
    * `:stopping` - a callback has returned `{:stop, reason, state}`; the process is about to exit
    * `:backoff` - no process runs; the next one is started after a delay
    * `:ignored` - `init/1` has returned `:ignore`; no process is started again

  ## Transitions

  | phase | event | next phase | actions |
  |---|---|---|---|
  | `:starting` | `:started` | `:starting` | `{:watch_init, ms}` |
  | `:starting` | `{:start_failed, reason}` | `:backoff` | `{:retry_after, ms}` |
  | `:starting` | `:orphan_found` | `:blocked` | |
  | `:blocked` | `:orphan_exited` | `:starting` | `:start` |
  | `:starting` | `:init_timeout` | `:starting`, with the status `:stale` | |
  | `:starting` | `:up` | `:running` | `:watch_activity` |
  | `:running` | `:stopping` | `:stopping` | |
  | `:running`, `:stopping` | `{:activity_checked, previous_ns, last_ns}` | the same, with the status `:up` or `:stale` | |
  | `:starting`, `:running`, `:stopping` | `{:exited, {:absent or :crash, reason}}` | `:backoff` | `{:retry_after, ms}` |
  | `:starting`, `:running`, `:stopping` | `{:exited, :ignored}` | `:ignored` | |
  | `:backoff` | `:retry` | `:starting` | `:start` |
  | any | `{:trouble, reason}` | the same | |

  Any other event changes nothing.
  """

  alias BB.Component.{Backoff, Server, Status}

  @init_timeout_ms 5_000

  @enforce_keys [:status]
  defstruct [:status, :max_silence_ns, phase: :starting]

  @type phase :: :starting | :blocked | :running | :stopping | :backoff | :ignored

  @type t :: %__MODULE__{
          phase: phase(),
          status: Status.t(),
          max_silence_ns: pos_integer() | nil
        }

  @typedoc "Why a component's process has exited."
  @type outcome :: {Backoff.cause(), reason :: term()} | :ignored

  @type event ::
          :started
          | {:start_failed, reason :: term()}
          | :orphan_found
          | :orphan_exited
          | :init_timeout
          | :up
          | :stopping
          | {:activity_checked, previous_ns :: integer(), last_ns :: integer()}
          | {:exited, outcome()}
          | :retry
          | {:trouble, reason :: term()}

  @typedoc """
  What the keeper does: start the component's process, watch over its `init/1` for so long, watch
  its activity, or start it again after a delay.
  """
  @type action ::
          :start
          | {:watch_init, pos_integer()}
          | :watch_activity
          | {:retry_after, pos_integer()}

  @doc """
  Returns the lifecycle of a component that is about to be started.

  `restarts` is the number of restarts by earlier keepers of the same component.
  """
  @spec new(integer(), pos_integer() | nil, non_neg_integer()) :: t()
  def new(now_ns, max_silence_ns \\ nil, restarts \\ 0),
    do: %__MODULE__{status: Status.new(now_ns, restarts), max_silence_ns: max_silence_ns}

  @doc """
  Classifies the exit reason of the component's process.

  An exit counts as `:absent` when the component announced it, by `{:stop, reason}` from `init/1`
  or from a later callback. Any other exit is a `:crash`.

      iex> alias BB.Component.Lifecycle
      iex> Lifecycle.outcome(%{Lifecycle.new(0) | phase: :stopping}, :no_answer)
      {:absent, :no_answer}
      iex> Lifecycle.outcome(%{Lifecycle.new(0) | phase: :running}, :killed)
      {:crash, :killed}
  """
  @spec outcome(t(), exit_reason :: term()) :: outcome()
  def outcome(_lifecycle, {:shutdown, {Server, {:absent, reason}}}), do: {:absent, reason}
  def outcome(_lifecycle, {:shutdown, {Server, :ignored}}), do: :ignored
  def outcome(%__MODULE__{phase: :stopping}, reason), do: {:absent, reason}
  def outcome(_lifecycle, reason), do: {:crash, reason}

  @doc "Returns the lifecycle after an event, and the actions that the keeper carries out."
  @spec transition(t(), event(), integer()) :: {t(), [action()]}
  def transition(lifecycle, event, now_ns)

  def transition(%{phase: :starting} = lifecycle, :started, _now_ns),
    do: {lifecycle, [{:watch_init, @init_timeout_ms}]}

  def transition(%{phase: :starting} = lifecycle, {:start_failed, reason}, now_ns),
    do: back_off(lifecycle, :absent, reason, now_ns)

  def transition(%{phase: :starting} = lifecycle, :orphan_found, _now_ns),
    do: {%{lifecycle | phase: :blocked}, []}

  def transition(%{phase: :blocked} = lifecycle, :orphan_exited, _now_ns),
    do: {%{lifecycle | phase: :starting}, [:start]}

  def transition(%{phase: :starting} = lifecycle, :init_timeout, now_ns) do
    reason = {:init_timeout, @init_timeout_ms}
    {%{lifecycle | status: Status.stale(lifecycle.status, reason, now_ns)}, []}
  end

  def transition(%{phase: :starting} = lifecycle, :up, now_ns) do
    status = Status.up(lifecycle.status, now_ns)
    {%{lifecycle | phase: :running, status: status}, [:watch_activity]}
  end

  def transition(%{phase: :running} = lifecycle, :stopping, _now_ns),
    do: {%{lifecycle | phase: :stopping}, []}

  def transition(%{phase: phase} = lifecycle, {:activity_checked, previous_ns, last_ns}, now_ns)
      when phase in [:running, :stopping] do
    {%{lifecycle | status: check_silence(lifecycle, previous_ns, last_ns, now_ns)}, []}
  end

  def transition(%{phase: phase} = lifecycle, {:exited, outcome}, now_ns)
      when phase in [:starting, :running, :stopping] do
    case outcome do
      :ignored ->
        {%{lifecycle | phase: :ignored, status: Status.ignored(lifecycle.status, now_ns)}, []}

      {cause, reason} ->
        back_off(lifecycle, cause, reason, now_ns)
    end
  end

  def transition(%{phase: :backoff} = lifecycle, :retry, now_ns) do
    status = Status.restarted(lifecycle.status, now_ns)
    {%{lifecycle | phase: :starting, status: status}, [:start]}
  end

  def transition(lifecycle, {:trouble, reason}, _now_ns),
    do: {%{lifecycle | status: Status.put_last_error(lifecycle.status, reason)}, []}

  def transition(lifecycle, _event, _now_ns), do: {lifecycle, []}

  defp back_off(lifecycle, cause, reason, now_ns) do
    status = Status.down(lifecycle.status, cause, reason, now_ns)
    {%{lifecycle | phase: :backoff, status: status}, [{:retry_after, status.retry_in_ms}]}
  end

  # New activity ends a silence even when it is old by now: the next check then makes the
  # component stale again, and both changes are published.
  defp check_silence(%{status: %{state: :stale} = status}, previous_ns, last_ns, now_ns)
       when last_ns > previous_ns,
       do: Status.active(status, now_ns)

  defp check_silence(%{status: status, max_silence_ns: max_silence_ns}, _, last_ns, now_ns) do
    if now_ns - last_ns >= max_silence_ns,
      do: Status.stale(status, {:silent, div(max_silence_ns, 1_000_000)}, now_ns),
      else: Status.active(status, now_ns)
  end
end
