defmodule BB.Sensor.EmergencyStop.Decision do
  @moduledoc """
  When an emergency stop halts its robot, and when it lets go. Pure; times are nanoseconds of one clock.

  It halts at the first sign that the contact is not closed: any edge, a reading that is open, no reading at all. It lets go when
  the contact was closed, without an edge, for the release time.

      iex> alias BB.Sensor.EmergencyStop.Decision
      iex> {:released, d} = Decision.new(:closed, 100)
      iex> {:halt, d} = Decision.edge(d)
      iex> {:listen, d} = Decision.see(d, :closed, 1_000)
      iex> {:stay, d} = Decision.see(d, :closed, 1_050)
      iex> {:release, d} = Decision.see(d, :closed, 1_100)
      iex> {:stay, _d} = Decision.see(d, :closed, 1_150)
  """

  @enforce_keys [:state, :release_ns]
  defstruct [:state, :release_ns, :closed_ns, unrest: 0]

  @typedoc "`:halted` or `:released`; `closed_ns` is since when the contact of one that is halted is closed, `nil` while it is not."
  @type t :: %__MODULE__{
          state: :halted | :released,
          release_ns: non_neg_integer(),
          closed_ns: integer() | nil,
          unrest: non_neg_integer()
        }

  # So many attempts to let go that an edge undid, one after the other, are no hand.
  @most_unrest 25

  @doc "What it is at first, by the contact as it is found."
  @spec new(:closed | :open, non_neg_integer()) :: {:halted | :released, t()}
  def new(:closed, release_ns),
    do: {:released, %__MODULE__{state: :released, release_ns: release_ns}}

  def new(:open, release_ns), do: {:halted, %__MODULE__{state: :halted, release_ns: release_ns}}

  @doc "An edge: `:halt`, `:wait` (no more edges need be told until it is closed again), or `:restless`."
  @spec edge(t()) :: {:halt | :wait | :restless, t()}
  def edge(%{state: :released} = decision), do: {:halt, halted(decision)}

  def edge(%{unrest: unrest} = decision) when unrest + 1 < @most_unrest,
    do: {:wait, %{decision | closed_ns: nil, unrest: unrest + 1}}

  def edge(decision), do: {:restless, %{decision | closed_ns: nil}}

  @doc """
  The contact was looked at. `:halt` and `:release` are changes; `:listen` says that edges are to be told from now on, because it
  may soon be released; `:stay` that nothing is to be done.
  """
  @spec see(t(), :closed | :open, integer()) :: {:halt | :release | :listen | :stay, t()}
  def see(%{state: :released} = decision, :closed, _now_ns), do: {:stay, decision}
  def see(%{state: :released} = decision, :open, _now_ns), do: {:halt, halted(decision)}

  def see(%{closed_ns: nil} = decision, :closed, now_ns),
    do: {:listen, %{decision | closed_ns: now_ns}}

  def see(%{closed_ns: closed_ns, release_ns: release_ns} = decision, :closed, now_ns)
      when now_ns - closed_ns >= release_ns,
      do: {:release, %{decision | state: :released, closed_ns: nil, unrest: 0}}

  def see(decision, :closed, _now_ns), do: {:stay, decision}
  # Of a line that changes all the time, half of the readings are open.
  def see(decision, :open, _now_ns), do: {:stay, %{decision | closed_ns: nil}}

  defp halted(decision), do: %{decision | state: :halted, closed_ns: nil, unrest: 0}
end
