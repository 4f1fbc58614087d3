defmodule BB.Component.Status do
  @moduledoc """
  The status of a component, as `health/1` shows it and its keeper publishes it.

  `BB.Component.Lifecycle` calls these functions for each event. The module is pure; times are
  monotonic nanoseconds.

      iex> alias BB.Component.Status
      iex> status = Status.new(0) |> Status.up(1) |> Status.down(:absent, :no_answer, 2)
      iex> {status.state, status.reason, status.retry_in_ms in 50..100}
      {:backoff, :no_answer, true}

  ## States

    * `:starting` - the robot has just started, and the first `init/1` has not returned
    * `:up` - the component runs
    * `:stale` - the component runs but is silent: it has published or carried nothing for its
      `max_silence`, or its `init/1` does not return. Its process is not restarted, since only the
      component can know whether its device is merely slow. It is up again with its next message
    * `:backoff` - the component went down and is restarted after `retry_in_ms`. The state stays
      `:backoff` until the new `init/1` has returned `{:ok, state}`
    * `:ignored` - `init/1` returned `:ignore`; the component is not restarted
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

  @doc """
  Returns the status of a component that is about to be started.

  `restarts` is the number of restarts by earlier keepers of the same component.
  """
  @spec new(integer(), non_neg_integer()) :: t()
  def new(now_ns, restarts \\ 0),
    do: %__MODULE__{since_ns: now_ns, started_ns: now_ns, restarts: restarts}

  @doc "Returns the status of a component that is started again."
  @spec restarted(t(), integer()) :: t()
  def restarted(status, now_ns),
    do: %{status | restarts: status.restarts + 1, retry_in_ms: nil, started_ns: now_ns}

  @doc "Returns the status of a component whose `init/1` has succeeded."
  @spec up(t(), integer()) :: t()
  def up(status, now_ns), do: %{put_state(status, :up, nil, now_ns) | up_since_ns: now_ns}

  @doc "Returns the status of a component that has crashed, or whose device is absent."
  @spec down(t(), Backoff.cause(), term(), integer()) :: t()
  def down(status, cause, reason, now_ns) do
    {delay_ms, backoff} =
      status.backoff
      |> Backoff.ran(run_ms(status, now_ns))
      |> Backoff.next(cause, init_ms(status, now_ns))

    status = put_state(status, :backoff, Reason.normalize(reason), now_ns)
    %{status | up_since_ns: nil, retry_in_ms: delay_ms, backoff: backoff}
  end

  @doc "Returns the status of a component whose `init/1` has returned `:ignore`."
  @spec ignored(t(), integer()) :: t()
  def ignored(status, now_ns),
    do: %{put_state(status, :ignored, nil, now_ns) | up_since_ns: nil}

  @doc "Returns the status of a component that runs and is silent."
  @spec stale(t(), term(), integer()) :: t()
  def stale(status, reason, now_ns), do: put_state(status, :stale, reason, now_ns)

  @doc """
  Returns the status of a component that has published something: a stale one is up.

  A component whose `init/1` has not returned stays stale.
  """
  @spec active(t(), integer()) :: t()
  def active(%{state: :stale, up_since_ns: up_since_ns} = status, now_ns)
      when is_integer(up_since_ns),
      do: put_state(status, :up, nil, now_ns)

  def active(status, _now_ns), do: status

  @doc "Sets the last error of a component that runs on in spite of it."
  @spec put_last_error(t(), term()) :: t()
  def put_last_error(status, reason), do: %{status | last_error: Reason.normalize(reason)}

  @doc """
  Sets the text of the last error, `format.(last_error)`.

  The text of the old status is kept while the error is the same, so that `format` is called once
  for each error.
  """
  @spec put_error_text(t(), t(), (term() -> String.t())) :: t()
  def put_error_text(%{last_error: nil} = status, _old, _format), do: status

  def put_error_text(%{last_error: error} = status, %{last_error: error, error: text}, _format)
      when is_binary(text),
      do: %{status | error: text}

  def put_error_text(status, _old, format), do: %{status | error: format.(status.last_error)}

  @doc "Returns whether the state or its reason has changed, which is then published."
  @spec changed?(t(), t()) :: boolean()
  def changed?(old, new), do: {old.state, old.reason} != {new.state, new.reason}

  @doc "Returns whether the state calls for an alarm."
  @spec alarm?(t()) :: boolean()
  def alarm?(status), do: status.state in [:backoff, :stale]

  defp put_state(status, state, reason, now_ns) do
    since_ns = if state == status.state, do: status.since_ns, else: now_ns
    last_error = if reason == nil, do: status.last_error, else: reason

    %{status | state: state, since_ns: since_ns}
    |> Map.merge(%{reason: reason, last_error: last_error, retry_in_ms: nil})
  end

  defp run_ms(%{up_since_ns: nil}, _now_ns), do: 0
  defp run_ms(status, now_ns), do: to_ms(now_ns - status.up_since_ns)

  defp init_ms(status, now_ns), do: to_ms((status.up_since_ns || now_ns) - status.started_ns)

  defp to_ms(ns), do: System.convert_time_unit(ns, :nanosecond, :millisecond)
end
