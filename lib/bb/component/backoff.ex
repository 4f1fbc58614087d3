defmodule BB.Component.Backoff do
  @moduledoc """
  The delay before a component is started again: exponential, with jitter, without an end.

  `BB.Component.Status` computes the delay after each failure. The module is pure.

      iex> backoff = BB.Component.Backoff.new(random: fn -> 1.0 end)
      iex> {first, backoff} = BB.Component.Backoff.next(backoff, :crash)
      iex> {second, backoff} = BB.Component.Backoff.next(backoff, :crash)
      iex> backoff = BB.Component.Backoff.ran(backoff, 3_000)
      iex> {third, _backoff} = BB.Component.Backoff.next(backoff, :crash)
      iex> {first, second, third}
      {100, 200, 100}

  ## The delay

      delay = min(100 ms · 2ⁿ, cap) × a random factor in 0.5..1.0

  n counts the failures of one cause since the last stable run, so the first retry comes within
  100 ms. The cap depends on the cost of a retry. Only a retry shows that a fault has ended, so a
  cheap one is made at least every 750 ms: a component that starts at once is up again within a
  second of the end of its fault, however long the fault lasted and however often it occurred.

  Two causes are counted separately:

    * `:absent` - the component reported that it cannot work: `{:stop, reason}` from `init/1` or
      from a later callback. Its device does not answer, and a retry costs one transfer. The cap
      is 750 ms.
    * `:crash` - the component raised, exited or was killed. The cap is four times the duration of
      its `init/1`, so that the retries of a component that starts slowly and crashes take at most
      about a fifth of the time (with the longest delay; a third with the shortest). The cap is at
      least 750 ms and at most 5 s. The quicker `init/1` of the last two failures counts, so that
      a machine that stands still for a moment makes no component slow.

  A run is stable when it lasted at least a second, and at least four times the delay before it. A
  stable run resets both counters.
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

  @doc """
  Returns a backoff without failures. The option `:random` replaces the random numbers in tests.
  """
  @spec new(random: (() -> float())) :: t()
  def new(opts \\ []), do: struct!(__MODULE__, opts)

  @doc "Counts a failure after an `init/1` of `init_ms` milliseconds: `{delay_ms, backoff}`."
  @spec next(t(), cause(), non_neg_integer()) :: {pos_integer(), t()}
  def next(%__MODULE__{} = backoff, cause, init_ms \\ 0) do
    factor = 0.5 + backoff.random.() / 2
    delay_ms = trunc(longest_ms(backoff, cause, init_ms) * factor)
    failures = Map.update!(backoff.failures, cause, &(&1 + 1))
    {delay_ms, put_init_ms(%{backoff | failures: failures, delay_ms: delay_ms}, cause, init_ms)}
  end

  defp put_init_ms(backoff, :crash, init_ms), do: %{backoff | init_ms: init_ms}
  defp put_init_ms(backoff, :absent, _init_ms), do: backoff

  @doc "Returns the longest delay in milliseconds that the next failure of `cause` can bring."
  @spec longest_ms(t(), cause(), non_neg_integer()) :: pos_integer()
  def longest_ms(%__MODULE__{failures: failures} = backoff, cause, init_ms \\ 0) do
    # Before the first failure the duration is :infinity, which is above any number.
    cap_ms = cap_ms(cause, min(init_ms, backoff.init_ms))
    double(@base_ms, Map.fetch!(failures, cause), cap_ms)
  end

  defp cap_ms(:absent, _init_ms), do: @cheap_cap_ms
  defp cap_ms(:crash, init_ms), do: (@cap_inits * init_ms) |> max(@cheap_cap_ms) |> min(@cap_ms)

  @doc "Counts a run of `run_ms` milliseconds. A stable run resets the failures."
  @spec ran(t(), non_neg_integer()) :: t()
  def ran(%__MODULE__{} = backoff, run_ms) do
    if run_ms >= @stable_ms and run_ms >= @stable_delays * backoff.delay_ms,
      do: new(random: backoff.random),
      else: backoff
  end

  defp double(ms, _doublings, cap_ms) when ms >= cap_ms, do: cap_ms
  defp double(ms, 0, _cap_ms), do: ms
  defp double(ms, doublings, cap_ms), do: double(2 * ms, doublings - 1, cap_ms)
end
