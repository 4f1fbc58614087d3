defmodule BB.Component.Status do
  @moduledoc """
  How a component fares, and what each thing that happens to it makes of that. Pure; times are monotonic nanoseconds.

  The states:

    * `:starting` - since the robot was started its first `init` has not returned
    * `:up` - it runs
    * `:stale` - it runs but is silent: it published or carried nothing for its `max_silence`, or
      its `init` does not return. It is left alone: only it can know whether its device is merely
      slow, and a process that hangs in a callback is up again with its next message
    * `:backoff` - it went down and is started again after `retry_in_ms`; so until its `init` has returned `{:ok, …}`
    * `:ignored` - its `init` returned `:ignore`; it is not started again
  """

  alias BB.Component.{Backoff, Reason}

  @enforce_keys [:since_ns, :started_ns]
  defstruct [
    :since_ns,
    :started_ns,
    :up_since_ns,
    :reason,
    :last_error,
    :error,
    :retry_in_ms,
    state: :starting,
    restarts: 0,
    backoff: Backoff.new()
  ]

  @type state :: :starting | :up | :stale | :backoff | :ignored

  @type t :: %__MODULE__{
          since_ns: integer(),
          started_ns: integer(),
          up_since_ns: integer() | nil,
          reason: term(),
          last_error: term(),
          error: String.t() | nil,
          retry_in_ms: pos_integer() | nil,
          state: state(),
          restarts: non_neg_integer(),
          backoff: Backoff.t()
        }

  @doc "A component that is started for the first time, or whose keeper is, after so many `restarts`."
  @spec new(integer(), non_neg_integer()) :: t()
  def new(now_ns, restarts \\ 0),
    do: %__MODULE__{since_ns: now_ns, started_ns: now_ns, restarts: restarts}

  @doc "It is started again."
  @spec restarted(t(), integer()) :: t()
  def restarted(status, now_ns),
    do: %{status | restarts: status.restarts + 1, retry_in_ms: nil, started_ns: now_ns}

  @doc "Its `init` succeeded."
  @spec up(t(), integer()) :: t()
  def up(status, now_ns), do: %{enter(status, :up, nil, now_ns) | up_since_ns: now_ns}

  @doc "It went down: it crashed, or said that its device is absent."
  @spec down(t(), Backoff.cause(), term(), integer()) :: t()
  def down(status, cause, reason, now_ns) do
    {delay_ms, backoff} =
      status.backoff
      |> Backoff.ran(run_ms(status, now_ns))
      |> Backoff.next(cause, init_ms(status, now_ns))

    status = enter(status, :backoff, Reason.plain(reason), now_ns)
    %{status | up_since_ns: nil, retry_in_ms: delay_ms, backoff: backoff}
  end

  @doc "Its `init` returned `:ignore`."
  @spec ignored(t(), integer()) :: t()
  def ignored(status, now_ns),
    do: %{enter(status, :ignored, nil, now_ns) | up_since_ns: nil}

  @doc "It runs but is silent."
  @spec silent(t(), term(), integer()) :: t()
  def silent(status, reason, now_ns), do: enter(status, :stale, reason, now_ns)

  @doc "It goes on, and something is wrong all the same."
  @spec troubled(t(), term()) :: t()
  def troubled(status, reason), do: %{status | last_error: Reason.plain(reason)}

  @doc "It published something."
  @spec heard(t(), integer()) :: t()
  def heard(%{state: :stale, up_since_ns: up_since_ns} = status, now_ns)
      when is_integer(up_since_ns),
      do: enter(status, :up, nil, now_ns)

  def heard(status, _now_ns), do: status

  @doc "The words for its last error, `words.(last_error)`, which is asked once for each error."
  @spec explain(t(), t(), (term() -> String.t())) :: t()
  def explain(_old, %{last_error: nil} = status, _words), do: status

  def explain(%{last_error: error, error: words}, %{last_error: error} = status, _words)
      when is_binary(words),
      do: %{status | error: words}

  def explain(_old, status, words), do: %{status | error: words.(status.last_error)}

  @doc "Whether the second differs from the first in a way that the world should hear about."
  @spec news?(t(), t()) :: boolean()
  def news?(old, new), do: {old.state, old.reason} != {new.state, new.reason}

  @doc "Whether it is in a state that calls for an alarm."
  @spec alarming?(t()) :: boolean()
  def alarming?(status), do: status.state in [:backoff, :stale]

  defp enter(status, state, reason, now_ns) do
    since_ns = if state == status.state, do: status.since_ns, else: now_ns
    last_error = if reason == nil, do: status.last_error, else: reason

    %{status | state: state, since_ns: since_ns}
    |> Map.merge(%{reason: reason, last_error: last_error, retry_in_ms: nil})
  end

  defp run_ms(%{up_since_ns: nil}, _now_ns), do: 0

  defp run_ms(status, now_ns), do: ms(now_ns - status.up_since_ns)

  defp init_ms(status, now_ns),
    do: ms((status.up_since_ns || now_ns) - status.started_ns)

  defp ms(ns), do: System.convert_time_unit(ns, :nanosecond, :millisecond)
end
