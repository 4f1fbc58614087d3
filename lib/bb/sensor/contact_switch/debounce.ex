defmodule BB.Sensor.ContactSwitch.Debounce do
  @moduledoc """
  When a contact that bounces has come to rest, and where. Pure; times are nanoseconds of one clock.

  After an edge the level is left alone for a time, and looked at when that is over. So what is shorter than that time is never seen,
  and a line that never rests costs two looks in that time and no more.

      iex> alias BB.Sensor.ContactSwitch.Debounce
      iex> {:wait, 5_000_000, d} = 5_000_000 |> Debounce.new(1) |> Debounce.edge(0)
      iex> {:same, d} = Debounce.edge(d, 1_000_000)
      iex> {:changed, d} = Debounce.rest(d, 5_000_000, 0)
      iex> d.level
      0
  """

  @enforce_keys [:window_ns, :level]
  defstruct [:window_ns, :level, :rested_ns, waiting?: false, unrest: 0]

  @type t :: %__MODULE__{
          window_ns: non_neg_integer(),
          level: 0 | 1,
          rested_ns: integer() | nil,
          waiting?: boolean(),
          unrest: non_neg_integer()
        }

  # So many changes without a rest of so long are no hand.
  @most_unrest 50
  @rest_ms 20

  @doc "A contact at rest."
  @spec new(non_neg_integer(), 0 | 1) :: t()
  def new(window_ns, level), do: %__MODULE__{window_ns: window_ns, level: level}

  @doc """
  An edge: `{:wait, until_ns, debounce}` for when to look, `{:same, debounce}` while that is still to come, or `:restless` after
  #{@most_unrest} edges none of which came after a rest: as long as is waited for, and at least #{@rest_ms} ms, since a busy machine hears edges late. A
  rest makes up for as many of them as it is times as long.
  """
  @spec edge(t(), integer()) :: {:wait, integer(), t()} | {:same, t()} | :restless
  def edge(%{waiting?: true} = debounce, _now_ns), do: {:same, debounce}

  def edge(debounce, now_ns) do
    case unrest(debounce, now_ns) do
      @most_unrest ->
        :restless

      unrest ->
        {:wait, now_ns + debounce.window_ns, %{debounce | waiting?: true, unrest: unrest}}
    end
  end

  @doc "The level that was found: whether it is another than before."
  @spec rest(t(), integer(), 0 | 1) :: {:changed | :same, t()}
  def rest(debounce, now_ns, level) do
    what = if level == debounce.level, do: :same, else: :changed
    {what, %{debounce | level: level, waiting?: false, rested_ns: now_ns}}
  end

  defp unrest(%{rested_ns: nil}, _now_ns), do: 0

  defp unrest(debounce, now_ns) do
    case div(now_ns - debounce.rested_ns, max(debounce.window_ns, @rest_ms * 1_000_000)) do
      0 -> debounce.unrest + 1
      rests -> max(debounce.unrest - rests, 0)
    end
  end
end
