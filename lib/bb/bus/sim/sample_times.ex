defmodule BB.Bus.Sim.SampleTimes do
  @moduledoc """
  The times at which a simulated chip samples by itself: the end of each period since a start.

  The models of chips that measure at a rate use it. A bus calls a model only for a transfer, and
  the chip then shows its latest sample. The module is pure.

      iex> alias BB.Bus.Sim.SampleTimes
      iex> times = SampleTimes.new(10, 100)
      iex> SampleTimes.take_latest(times, 109)
      :none
      iex> {:ok, time_ns, times} = SampleTimes.take_latest(times, 135)
      iex> {time_ns, SampleTimes.take_latest(times, 136)}
      {130, :none}
  """

  @enforce_keys [:start_ns, :period_ns]
  defstruct [:start_ns, :period_ns, taken: 0]

  @typedoc "The sample times of a chip. `:taken` is the number of the latest sample."
  @type t :: %__MODULE__{
          start_ns: integer(),
          period_ns: pos_integer(),
          taken: non_neg_integer()
        }

  @doc "Returns sample times that start now. The first one is a period later."
  @spec new(pos_integer(), integer()) :: t()
  def new(period_ns, now_ns), do: %__MODULE__{start_ns: now_ns, period_ns: period_ns}

  @doc "Returns the time of the latest sample, or `:none` when there is none since the last call."
  @spec take_latest(t(), integer()) :: {:ok, integer(), t()} | :none
  def take_latest(times, now_ns) do
    count = div(now_ns - times.start_ns, times.period_ns)

    if count > times.taken,
      do: {:ok, times.start_ns + count * times.period_ns, %{times | taken: count}},
      else: :none
  end
end
