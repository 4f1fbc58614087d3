defmodule BB.Sensor.As5600.Track do
  @moduledoc """
  Angles within a turn, one after the other, as a position over many turns, with its velocity. Pure.

  From one angle to the next the shaft is taken to have gone the shorter way. The nearer that is to half a turn, the less is it to be
  trusted: beyond three eighths, or when the shaft was so fast before that it may have gone as far, the turns are no longer known, and
  that is an error for good.
  """
  alias BB.Sensor.As5600.Registers

  @steps Registers.steps()
  @farthest div(3 * @steps, 8)

  @enforce_keys [:first_step, :window_ns]
  defstruct [:first_step, :window_ns, :position, past: []]

  @typedoc """
  `position` in steps over all turns; `past` the positions of the window in which the velocity is measured, `{time_ns, position}`, the
  latest first.
  """
  @type t :: %__MODULE__{
          first_step: integer(),
          window_ns: pos_integer(),
          position: integer() | nil,
          past: [{integer(), integer()}]
        }

  @doc """
  A track whose first position is in the turn that begins at `from` rad, and whose velocity is that over the last `window` seconds.
  """
  @spec new(number(), number()) :: t()
  def new(from, window) do
    %__MODULE__{
      first_step: ceil(from / (2 * :math.pi()) * @steps - 1.0e-6),
      window_ns: round(window * 1.0e9)
    }
  end

  @doc """
  Adds an angle, in steps, at a time: the position in rad and the velocity in rad/s, `nil` at the first.

      iex> track = BB.Sensor.As5600.Track.new(0, 0.05)
      iex> {:ok, %{velocity: nil}, track} = BB.Sensor.As5600.Track.add(track, 4095, 0)
      iex> {:ok, reading, _track} = BB.Sensor.As5600.Track.add(track, 1, 10_000_000)
      iex> {Float.round(reading.position / (2 * :math.pi()) * 4096, 6), Float.round(reading.velocity, 6)}
      {4097.0, 0.306796}
  """
  @spec add(t(), 0..4095, integer()) ::
          {:ok, %{position: float(), velocity: float() | nil}, t()} | {:error, :too_fast}
  def add(%{position: nil} = track, angle, now_ns) do
    position = track.first_step + Integer.mod(angle - track.first_step, @steps)
    reached(track, position, now_ns)
  end

  def add(track, angle, now_ns) do
    way = shorter(angle - track.position)

    if abs(way) > @farthest or abs(expected(track, now_ns)) > @farthest,
      do: {:error, :too_fast},
      else: reached(track, track.position + way, now_ns)
  end

  @doc "The same position and past, for new options."
  @spec continue(t(), t()) :: t()
  def continue(new, old), do: %{new | position: old.position, past: old.past}

  defp shorter(way), do: Integer.mod(way + div(@steps, 2), @steps) - div(@steps, 2)

  defp expected(%{past: [{time_ns, _position} | _]} = track, now_ns),
    do: (rate(track.past) || 0.0) * (now_ns - time_ns)

  defp reached(track, position, now_ns) do
    past = [{now_ns, position} | recent(track.past, now_ns - track.window_ns)]
    velocity = with steps_per_ns when steps_per_ns != nil <- rate(past), do: steps_per_ns * 1.0e9

    reading = %{
      position: Registers.radians(position),
      velocity: velocity && Registers.radians(velocity)
    }

    {:ok, reading, %{track | position: position, past: past}}
  end

  # The one before is always kept: a slow rate has no other.
  defp recent([], _since_ns), do: []

  defp recent([last | older], since_ns),
    do: [last | Enum.take_while(older, fn {time_ns, _} -> time_ns >= since_ns end)]

  # In steps a nanosecond.
  defp rate([{now_ns, now} | [_ | _] = past]) do
    {then_ns, then} = List.last(past)
    if now_ns > then_ns, do: (now - then) / (now_ns - then_ns)
  end

  defp rate(_none), do: nil
end
