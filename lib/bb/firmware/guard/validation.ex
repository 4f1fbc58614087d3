defmodule BB.Firmware.Guard.Validation do
  @moduledoc """
  Decides whether new firmware is validated or reverted, as a state machine with events and
  effects. Pure; the clock is an argument, in milliseconds, and never goes back.
  `BB.Firmware.Guard` runs it.

  A *check* is good or bad: a sensor, a round trip, the network. It becomes good with
  `{:good, check}`, stays good while such an event follows within `fresh_ms`, and becomes bad with
  `{:bad, check, reason}`. A check without events is not good.

  Firmware is validated when all required checks have been good together for `stability_ms`,
  without a break. A break restarts the window, so that flapping firmware is never validated.
  The board reverts when the firmware is not validated by `deadline_ms`.

      :asking ── :unvalidated ─► :watching ── stable ─► :validating ── :ok ─► :validated
         │                          │  ▲                     │
         │                          │  └────── {:error, _} ──┤
         │                          └─ deadline ─► :reverting ◄┘ deadline
         └─ :validated, :unknown, deadline ─► :settled

  The effects are `:set_heart`, `:init_complete`, `:validate`, `:clear_heart` and `:revert`. Each
  occurs at most once, except `:validate`, which is repeated after an error.
  """
  @moduledoc no_example: "internal: BB.Firmware.Guard is its interface"

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
  The reason for which a check does not hold: it was `:never` good; it was good last
  `{:silent, ms}` ago; it is `{:bad, reason}`; or it is
  `{:good_for, ms, breaks, last_reason}`, which is too short.
  """
  @type reason ::
          :never
          | {:silent, non_neg_integer()}
          | {:bad, term()}
          | {:good_for, non_neg_integer(), breaks :: non_neg_integer(), term()}

  @type t :: %__MODULE__{}

  @doc """
  Makes a validation.

  Options, all required: `required:` a list of checks, `stability_ms:`, `fresh_ms:`, and
  `deadline_ms:`, a time on the clock.
  """
  @spec new(keyword()) :: t()
  def new(opts), do: struct!(__MODULE__, opts)

  @doc "Handles an event, and returns the effects that follow from it."
  @spec handle(t(), event(), integer()) :: {t(), [effect()]}
  def handle(validation, event, now_ms),
    do: validation |> put_event(event, now_ms) |> decide(event, now_ms)

  @doc """
  Returns the required checks that do not hold, with reasons; `:validation` for a failed one.
  """
  @spec reasons(t(), integer()) :: [{check(), reason()}]
  def reasons(validation, now_ms) do
    failed = for error <- List.wrap(validation.validation_error), do: {:validation, {:bad, error}}

    failed ++
      for check <- validation.required,
          reason = reason(validation, validation.checks[check], now_ms),
          do: {check, reason}
  end

  @doc "Returns whether the validation is over, so that no effect will follow."
  @spec over?(t()) :: boolean()
  def over?(validation), do: validation.phase in [:validated, :reverting, :settled]

  # Checks

  defp put_event(validation, {:good, check}, now_ms),
    do: update(validation, check, &put_good(&1, now_ms, validation.fresh_ms))

  defp put_event(validation, {:bad, check, reason}, _now_ms),
    do: update(validation, check, &put_bad(&1, reason))

  defp put_event(validation, _event, _now_ms), do: validation

  @unseen %{since_ms: nil, last_ms: nil, reason: nil, breaks: 0}

  defp update(validation, check, fun),
    do: %{
      validation
      | checks: Map.put(validation.checks, check, fun.(validation.checks[check] || @unseen))
    }

  defp put_good(%{since_ms: nil} = seen, now_ms, _fresh_ms),
    do: %{seen | since_ms: now_ms, last_ms: now_ms}

  defp put_good(%{last_ms: last_ms} = seen, now_ms, fresh_ms) when now_ms - last_ms <= fresh_ms,
    do: %{seen | last_ms: now_ms}

  defp put_good(seen, now_ms, _fresh_ms) do
    silent = {:silent, now_ms - seen.last_ms}
    %{seen | since_ms: now_ms, last_ms: now_ms, breaks: seen.breaks + 1, reason: silent}
  end

  defp put_bad(%{since_ms: nil} = seen, reason), do: %{seen | reason: {:bad, reason}}

  defp put_bad(seen, reason),
    do: %{seen | since_ms: nil, breaks: seen.breaks + 1, reason: {:bad, reason}}

  # Phases

  defp decide(%{phase: :asking} = validation, {:status, :unvalidated}, now_ms) do
    {validation, effects} =
      decide(%{validation | phase: :watching, status: :unvalidated}, :tick, now_ms)

    {validation, [:set_heart, :init_complete | effects]}
  end

  defp decide(%{phase: :asking} = validation, {:status, status}, _now_ms)
       when status in [:validated, :unknown],
       do: {%{validation | phase: :settled, status: status}, [:init_complete]}

  # A board that never answers keeps its firmware, which may be good old firmware.
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
