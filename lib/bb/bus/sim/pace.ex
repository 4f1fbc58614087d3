defmodule BB.Bus.Sim.Pace do
  @moduledoc """
  When a simulated chip measures: at the end of each period since a start. Pure.

  A model is asked only when there is a transfer; what it shows then is what it measured last before.
  """

  @enforce_keys [:start_ns, :period_ns]
  defstruct [:start_ns, :period_ns, taken: 0]

  @type t :: %__MODULE__{
          start_ns: integer(),
          period_ns: pos_integer(),
          taken: non_neg_integer()
        }

  @doc "A pace that begins now; its first measurement is there a period later."
  @spec new(pos_integer(), integer()) :: t()
  def new(period_ns, now_ns), do: %__MODULE__{start_ns: now_ns, period_ns: period_ns}

  @doc """
  The time of the latest measurement, if there was one since the last time that it was asked, else `:none`.

      iex> pace = BB.Bus.Sim.Pace.new(10, 100)
      iex> BB.Bus.Sim.Pace.take(pace, 109)
      :none
      iex> {:ok, time_ns, pace} = BB.Bus.Sim.Pace.take(pace, 135)
      iex> {time_ns, BB.Bus.Sim.Pace.take(pace, 136)}
      {130, :none}
  """
  @spec take(t(), integer()) :: {:ok, integer(), t()} | :none
  def take(pace, now_ns) do
    count = div(now_ns - pace.start_ns, pace.period_ns)

    if count > pace.taken,
      do: {:ok, pace.start_ns + count * pace.period_ns, %{pace | taken: count}},
      else: :none
  end
end
