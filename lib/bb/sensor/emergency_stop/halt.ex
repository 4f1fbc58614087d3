defmodule BB.Sensor.EmergencyStop.Halt do
  @moduledoc """
  Decides when an emergency stop halts its robot, and when it releases the robot again.

  `BB.Sensor.EmergencyStop` keeps one, and does what it returns. The module is pure. Times are
  nanoseconds of one clock.

      iex> alias BB.Sensor.EmergencyStop.Halt
      iex> {:released, halt} = Halt.new(:closed, 100)
      iex> {:halt, halt} = Halt.edge(halt)
      iex> {:listen, halt} = Halt.reading(halt, :closed, 1_000)
      iex> {:none, halt} = Halt.reading(halt, :closed, 1_050)
      iex> {:release, halt} = Halt.reading(halt, :closed, 1_100)
      iex> {:none, _halt} = Halt.reading(halt, :closed, 1_150)

  It halts at the first sign that the contact is not closed: an edge, an open contact, or a failed
  reading. It releases when the contact was closed, without an edge, for the release time.
  """

  @enforce_keys [:state, :release_ns]
  defstruct [:state, :release_ns, :closed_ns, interrupted: 0]

  @typedoc """
  The state of an emergency stop.

  - `:state`: `:halted` or `:released`;
  - `:closed_ns`: the time since which the contact of a halted one is closed, otherwise `nil`;
  - `:interrupted`: how many releases in a row were interrupted by an edge.
  """
  @type t :: %__MODULE__{
          state: :halted | :released,
          release_ns: non_neg_integer(),
          closed_ns: integer() | nil,
          interrupted: non_neg_integer()
        }

  # A hand does not interrupt so many releases in a row. Noise does.
  @noise 25

  @doc "Returns the first state, from the contact's first reading."
  @spec new(:closed | :open, non_neg_integer()) :: {:halted | :released, t()}
  def new(:closed, release_ns),
    do: {:released, %__MODULE__{state: :released, release_ns: release_ns}}

  def new(:open, release_ns), do: {:halted, %__MODULE__{state: :halted, release_ns: release_ns}}

  @doc """
  Handles an edge of the line.

  Returns `:halt`, `:wait` (edges are not needed until the contact is closed again) or `:noise`.
  """
  @spec edge(t()) :: {:halt | :wait | :noise, t()}
  def edge(%{state: :released} = halt), do: {:halt, halted(halt)}

  def edge(%{interrupted: interrupted} = halt) when interrupted + 1 < @noise,
    do: {:wait, %{halt | closed_ns: nil, interrupted: interrupted + 1}}

  def edge(halt), do: {:noise, %{halt | closed_ns: nil}}

  @doc """
  Handles a reading of the contact.

  Returns `:halt` or `:release` for a change, `:listen` when edges are needed from now on because
  a release can follow, and `:none` when there is nothing to do.
  """
  @spec reading(t(), :closed | :open, integer()) :: {:halt | :release | :listen | :none, t()}
  def reading(%{state: :released} = halt, :closed, _now_ns), do: {:none, halt}
  def reading(%{state: :released} = halt, :open, _now_ns), do: {:halt, halted(halt)}

  def reading(%{closed_ns: nil} = halt, :closed, now_ns),
    do: {:listen, %{halt | closed_ns: now_ns}}

  def reading(%{closed_ns: closed_ns, release_ns: release_ns} = halt, :closed, now_ns)
      when now_ns - closed_ns >= release_ns,
      do: {:release, %{halt | state: :released, closed_ns: nil, interrupted: 0}}

  def reading(halt, :closed, _now_ns), do: {:none, halt}
  # An open contact does not reset the count: half of the readings of a noisy line are open.
  def reading(halt, :open, _now_ns), do: {:none, %{halt | closed_ns: nil}}

  defp halted(halt), do: %{halt | state: :halted, closed_ns: nil, interrupted: 0}
end
