defmodule BB.Firmware.Guard.Validation do
  @moduledoc """
  Whether new firmware stays: events in, what to do out. Pure; the clock is an argument, in milliseconds, and never goes back.

  A *check* is anything that can be good or bad: a sensor, a round trip, the network. It is good from a `{:good, check}` on, for as long as
  another one follows within `fresh_ms`, and until `{:bad, check, reason}`. Whoever says nothing is not good.

  Firmware is validated when all required checks have been good together, without a break, for `stability_ms`. When that has not
  happened by `deadline_ms`, the board reverts. A break begins the window anew, so that what flaps is never validated.

      :asking ── :unvalidated ─► :watching ── stable ─► :validating ── :ok ─► :validated
         │                          │  ▲                     │
         │                          │  └────── {:error, _} ──┤
         │                          └─ deadline ─► :reverting ◄┘ deadline
         └─ :validated, :unknown, deadline ─► :settled

  What to do is a list of effects: `:set_heart`, `:init_complete`, `:validate`, `:clear_heart`, `:revert`. Each but
  `:validate`, which is repeated after an error, comes once at most.
  """

  @retry_ms 1_000

  @enforce_keys [:required, :stability_ms, :deadline_ms, :fresh_ms]
  defstruct [
    :required,
    :stability_ms,
    :deadline_ms,
    :fresh_ms,
    :status,
    :retry_at_ms,
    :validation_error,
    phase: :asking,
    checks: %{}
  ]

  @type check :: atom() | {atom(), atom()}
  @type phase :: :asking | :watching | :validating | :validated | :reverting | :settled
  @type status :: :validated | :unvalidated | :unknown
  @type effect :: :set_heart | :init_complete | :validate | :clear_heart | :revert
  @type event ::
          {:status, status() | {:error, term()}}
          | {:good, check()}
          | {:bad, check(), reason :: term()}
          | {:validation, :ok | {:error, term()}}
          | :tick

  @typedoc """
  Why a check does not hold: `{:silent, ms}` since it was good last, or `:never` was; `{:bad, reason}`; `{:good_for, ms, breaks, last_reason}`, which
  is not long enough.
  """
  @type reason ::
          :never
          | {:silent, non_neg_integer()}
          | {:bad, term()}
          | {:good_for, non_neg_integer(), breaks :: non_neg_integer(), term()}

  @type t :: %__MODULE__{}

  @doc """
  Begins. Options, all required: `required:` a list of checks, `stability_ms:`, `fresh_ms:`, and `deadline_ms:`, which is a time on the clock.
  """
  @spec new(keyword()) :: t()
  def new(opts), do: struct!(__MODULE__, opts)

  @doc "What happened, and what is to be done about it."
  @spec handle(t(), event(), integer()) :: {t(), [effect()]}
  def handle(validation, event, now_ms),
    do: validation |> note(event, now_ms) |> decide(event, now_ms)

  @doc "The required checks that do not hold yet, and why; a failed validation as `:validation`."
  @spec reasons(t(), integer()) :: [{check(), reason()}]
  def reasons(validation, now_ms) do
    failed = for error <- List.wrap(validation.validation_error), do: {:validation, {:bad, error}}

    failed ++
      for check <- validation.required,
          reason = reason(validation, validation.checks[check], now_ms),
          do: {check, reason}
  end

  @doc "Whether it is over: nothing more will be done."
  @spec over?(t()) :: boolean()
  def over?(validation), do: validation.phase in [:validated, :reverting, :settled]

  # What is known

  defp note(validation, {:good, check}, now_ms),
    do: update(validation, check, &good(&1, now_ms, validation.fresh_ms))

  defp note(validation, {:bad, check, reason}, _now_ms),
    do: update(validation, check, &bad(&1, reason))

  defp note(validation, _event, _now_ms), do: validation

  @unseen %{since_ms: nil, last_ms: nil, reason: nil, breaks: 0}

  defp update(validation, check, fun),
    do: %{
      validation
      | checks: Map.put(validation.checks, check, fun.(validation.checks[check] || @unseen))
    }

  defp good(%{since_ms: nil} = seen, now_ms, _fresh_ms),
    do: %{seen | since_ms: now_ms, last_ms: now_ms}

  defp good(%{last_ms: last_ms} = seen, now_ms, fresh_ms) when now_ms - last_ms <= fresh_ms,
    do: %{seen | last_ms: now_ms}

  defp good(seen, now_ms, _fresh_ms) do
    silent = {:silent, now_ms - seen.last_ms}
    %{seen | since_ms: now_ms, last_ms: now_ms, breaks: seen.breaks + 1, reason: silent}
  end

  defp bad(%{since_ms: nil} = seen, reason), do: %{seen | reason: {:bad, reason}}

  defp bad(seen, reason),
    do: %{seen | since_ms: nil, breaks: seen.breaks + 1, reason: {:bad, reason}}

  # What follows

  defp decide(%{phase: :asking} = validation, {:status, :unvalidated}, now_ms) do
    {validation, effects} =
      decide(%{validation | phase: :watching, status: :unvalidated}, :tick, now_ms)

    {validation, [:set_heart, :init_complete | effects]}
  end

  defp decide(%{phase: :asking} = validation, {:status, status}, _now_ms)
       when status in [:validated, :unknown],
       do: {%{validation | phase: :settled, status: status}, [:init_complete]}

  # A board that cannot tell at all is left as it is: reverting what may be good old firmware would be worse.
  defp decide(%{phase: :asking, deadline_ms: deadline_ms} = validation, _event, now_ms)
       when now_ms >= deadline_ms,
       do: {%{validation | phase: :settled, status: :unknown}, [:init_complete]}

  defp decide(%{phase: :validating} = validation, {:validation, :ok}, _now_ms),
    do:
      {%{validation | phase: :validated, status: :validated, validation_error: nil},
       [:clear_heart]}

  defp decide(%{phase: :validating} = validation, {:validation, {:error, reason}}, now_ms) do
    retry = %{
      validation
      | phase: :watching,
        validation_error: reason,
        retry_at_ms: now_ms + @retry_ms
    }

    decide(retry, :tick, now_ms)
  end

  defp decide(%{phase: :validating, deadline_ms: deadline_ms} = validation, _event, now_ms)
       when now_ms >= deadline_ms,
       do: {%{validation | phase: :reverting, validation_error: :no_answer}, [:revert]}

  defp decide(%{phase: :watching} = validation, _event, now_ms) do
    cond do
      stable?(validation, now_ms) and not waiting?(validation, now_ms) ->
        {%{validation | phase: :validating}, [:validate]}

      now_ms >= validation.deadline_ms ->
        {%{validation | phase: :reverting}, [:revert]}

      true ->
        {validation, []}
    end
  end

  defp decide(validation, _event, _now_ms), do: {validation, []}

  defp waiting?(%{retry_at_ms: nil}, _now_ms), do: false
  defp waiting?(%{retry_at_ms: retry_at_ms}, now_ms), do: now_ms < retry_at_ms

  defp stable?(validation, now_ms),
    do:
      Enum.all?(validation.required, &(reason(validation, validation.checks[&1], now_ms) == nil))

  defp reason(_decision, nil, _now_ms), do: :never
  defp reason(_decision, %{since_ms: nil, reason: reason}, _now_ms), do: reason

  defp reason(validation, seen, now_ms) do
    cond do
      now_ms - seen.last_ms > validation.fresh_ms -> {:silent, now_ms - seen.last_ms}
      now_ms - seen.since_ms >= validation.stability_ms -> nil
      true -> {:good_for, now_ms - seen.since_ms, seen.breaks, seen.reason}
    end
  end
end
