defmodule BB.Component.Backoff do
  @moduledoc """
  How long to wait before a component is started again: exponential, with jitter, for ever. Pure.

      delay = min(base · 2ⁿ, cap) × a random factor in 0.5..1.0

  n counts the failures of one cause since the last stable run, so the first retry comes within 100 ms. The cap is a matter of
  what a try costs. Only a try shows that a fault has ended, so a cheap one is made at least every 750 ms: what starts at once
  is up again within a second of its fault's end, however long the fault lasted and however often it struck. There are two
  causes, counted apart:

    * `:absent` - the component said itself that it cannot work: its `init` returned `{:stop, reason}`, or a later callback
      did. That is a device which does not answer, and asking it again costs one transfer: the cap is 750 ms.
    * `:crash` - it raised, exited or was killed. The cap is four times the time that its `init` took, so that the tries of what
      is slow to start and crashes all the same take at most about a fifth of the time (with the longest delay; a
      third with the shortest); but at least 750 ms, and at most 5 s. Of its last two failures the quicker `init` counts: a
      machine that stands still for a moment makes nothing slow to start.

  A run is stable when it lasted at least a second, and at least four times the delay before it. A stable run forgets all
  failures.

      iex> backoff = BB.Component.Backoff.new(random: fn -> 1.0 end)
      iex> {first, backoff} = BB.Component.Backoff.next(backoff, :crash)
      iex> {second, backoff} = BB.Component.Backoff.next(backoff, :crash)
      iex> backoff = BB.Component.Backoff.ran(backoff, 3_000)
      iex> {third, _backoff} = BB.Component.Backoff.next(backoff, :crash)
      iex> {first, second, third}
      {100, 200, 100}
  """

  @base_ms 100
  @cheap_cap_ms 750
  @cap_ms 5_000
  @cap_inits 4
  @stable_ms 1_000
  @stable_delays 4

  defstruct failures: %{absent: 0, crash: 0},
            delay_ms: 0,
            init_ms: :infinity,
            random: &:rand.uniform/0

  @type cause :: :absent | :crash

  @typedoc "`random` returns a float in 0.0..1.0; the default is `:rand.uniform/0`."
  @type t :: %__MODULE__{
          failures: %{cause() => non_neg_integer()},
          delay_ms: non_neg_integer(),
          init_ms: non_neg_integer() | :infinity,
          random: (() -> float())
        }

  @doc "A backoff without failures. `random:` replaces the source of randomness, for exact tests."
  @spec new(random: (() -> float())) :: t()
  def new(opts \\ []), do: struct!(__MODULE__, opts)

  @doc "Counts a failure of something whose `init` took `init_ms` milliseconds: `{delay_ms, backoff}`."
  @spec next(t(), cause(), non_neg_integer()) :: {pos_integer(), t()}
  def next(%__MODULE__{} = backoff, cause, init_ms \\ 0) do
    factor = 0.5 + backoff.random.() / 2
    delay_ms = trunc(longest_ms(backoff, cause, init_ms) * factor)
    failures = Map.update!(backoff.failures, cause, &(&1 + 1))
    {delay_ms, took(%{backoff | failures: failures, delay_ms: delay_ms}, cause, init_ms)}
  end

  defp took(backoff, :crash, init_ms), do: %{backoff | init_ms: init_ms}
  defp took(backoff, :absent, _init_ms), do: backoff

  @doc "The longest delay that the next failure of `cause` can bring, in milliseconds."
  @spec longest_ms(t(), cause(), non_neg_integer()) :: pos_integer()
  def longest_ms(%__MODULE__{failures: failures} = backoff, cause, init_ms \\ 0) do
    # Any number is less than :infinity, the time before the first failure.
    cap_ms = cap_ms(cause, min(init_ms, backoff.init_ms))
    grow(@base_ms, Map.fetch!(failures, cause), cap_ms)
  end

  defp cap_ms(:absent, _init_ms), do: @cheap_cap_ms
  defp cap_ms(:crash, init_ms), do: (@cap_inits * init_ms) |> max(@cheap_cap_ms) |> min(@cap_ms)

  @doc "Tells of a run that ended after `run_ms` milliseconds; a stable one forgets the failures before it."
  @spec ran(t(), non_neg_integer()) :: t()
  def ran(%__MODULE__{} = backoff, run_ms) do
    if run_ms >= @stable_ms and run_ms >= @stable_delays * backoff.delay_ms,
      do: new(random: backoff.random),
      else: backoff
  end

  defp grow(ms, _doublings, cap_ms) when ms >= cap_ms, do: cap_ms
  defp grow(ms, 0, _cap_ms), do: ms
  defp grow(ms, doublings, cap_ms), do: grow(2 * ms, doublings - 1, cap_ms)
end
