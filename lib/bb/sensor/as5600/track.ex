defmodule BB.Sensor.As5600.Track do
  @moduledoc """
  Turns angles within a turn into a position over many turns, with its velocity.

  `BB.Sensor.As5600` keeps one. The module is pure.

      iex> alias BB.Sensor.As5600.Track
      iex> {:ok, %{velocity: nil}, track} = Track.add(Track.new(0, 0.05), 4095, 0)
      iex> {:ok, reading, _track} = Track.add(track, 1, 10_000_000)
      iex> Float.round(reading.position / (2 * :math.pi()) * 4096, 6)
      4097.0
      iex> Float.round(reading.velocity, 6)
      0.306796

  It assumes that the shaft has turned the shorter way from one angle to the next. This is certain
  up to three eighths of a turn. Beyond that, or when the last velocity may have taken the shaft
  beyond it, the turns are no longer known, which is an error for good.
  """
  alias BB.Sensor.As5600.Registers

  @steps Registers.steps()
  @farthest div(3 * @steps, 8)

  @enforce_keys [:first_step, :window_ns]
  defstruct [:first_step, :window_ns, :position, past: []]

  @typedoc """
  A track.

  - `:position`: in steps over all turns;
  - `:past`: the positions in the window over which the velocity is measured,
    `{time_ns, position}`, the latest first.
  """
  @type t :: %__MODULE__{
          first_step: integer(),
          window_ns: pos_integer(),
          position: integer() | nil,
          past: [{integer(), integer()}]
        }

  @doc """
  Returns a track whose first position is in the turn that begins at `from` rad, and whose
  velocity is measured over the last `window` seconds.
  """
  @spec new(number(), number()) :: t()
  def new(from, window) do
    %__MODULE__{
      first_step: ceil(from / (2 * :math.pi()) * @steps - 1.0e-6),
      window_ns: round(window * 1.0e9)
    }
  end

  @doc """
  Adds an angle in steps at a time.

  Returns the position in rad and the velocity in rad/s, which is `nil` for the first angle.
  """
  @spec add(t(), 0..4095, integer()) ::
          {:ok, %{position: float(), velocity: float() | nil}, t()} | {:error, :too_fast}
  def add(%{position: nil} = track, angle, now_ns) do
    position = track.first_step + Integer.mod(angle - track.first_step, @steps)
    put_position(track, position, now_ns)
  end

  def add(track, angle, now_ns) do
    way = shorter_way(angle - track.position)

    if abs(way) > @farthest or abs(expected_way(track, now_ns)) > @farthest,
      do: {:error, :too_fast},
      else: put_position(track, track.position + way, now_ns)
  end

  @doc "Returns the track `new` with the position and the past of `old`, for new options."
  @spec continue(t(), t()) :: t()
  def continue(new, old), do: %{new | position: old.position, past: old.past}

  defp shorter_way(way), do: Integer.mod(way + div(@steps, 2), @steps) - div(@steps, 2)

  defp expected_way(%{past: [{time_ns, _position} | _]} = track, now_ns),
    do: (rate(track.past) || 0.0) * (now_ns - time_ns)

  defp put_position(track, position, now_ns) do
    past = [{now_ns, position} | recent(track.past, now_ns - track.window_ns)]
    velocity = with steps_per_ns when steps_per_ns != nil <- rate(past), do: steps_per_ns * 1.0e9

    reading = %{
      position: Registers.radians(position),
      velocity: velocity && Registers.radians(velocity)
    }

    {:ok, reading, %{track | position: position, past: past}}
  end

  # The last position is always kept: at a slow rate it is the only one.
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
