defmodule BB.Sensor.ContactSwitch.Debounce do
  @moduledoc """
  Decides when a bouncing contact has come to rest, and at which level.

  `BB.Sensor.ContactSwitch` keeps one. Times are nanoseconds of one clock. The module is pure.

      iex> alias BB.Sensor.ContactSwitch.Debounce
      iex> {:wait, 5_000_000, debounce} = Debounce.edge(Debounce.new(5_000_000, 1), 0)
      iex> {:same, debounce} = Debounce.edge(debounce, 1_000_000)
      iex> {:changed, debounce} = Debounce.put_level(debounce, 5_000_000, 0)
      iex> debounce.level
      0

  After an edge the level is read when the debounce window is over. So a level that is shorter
  than the window is not seen, and a line that never rests costs two readings in each window.
  """

  @enforce_keys [:window_ns, :level]
  defstruct [:window_ns, :level, :rested_ns, waiting?: false, restless: 0]

  @typedoc """
  The state of a contact.

  - `:rested_ns`: the end of the last window;
  - `:waiting?`: whether a window is open;
  - `:restless`: how many edges came without a rest before them.
  """
  @type t :: %__MODULE__{
          window_ns: non_neg_integer(),
          level: 0 | 1,
          rested_ns: integer() | nil,
          waiting?: boolean(),
          restless: non_neg_integer()
        }

  # A hand does not make so many edges without such a rest. Noise does.
  @most_restless 50
  @rest_ms 20

  @doc "Returns the state of a contact at rest."
  @spec new(non_neg_integer(), 0 | 1) :: t()
  def new(window_ns, level), do: %__MODULE__{window_ns: window_ns, level: level}

  @doc """
  Handles an edge.

  Returns `{:wait, until_ns, debounce}` with the time at which to read the level,
  `{:same, debounce}` while a window is open, or `:noise`.

  `:noise` is more than #{@most_restless} edges without a rest before them. A rest is as long as
  the window, and at least #{@rest_ms} ms, because a busy machine delivers edges late. A longer
  rest makes up for as many edges as it has times that length.
  """
  @spec edge(t(), integer()) :: {:wait, integer(), t()} | {:same, t()} | :noise
  def edge(%{waiting?: true} = debounce, _now_ns), do: {:same, debounce}

  def edge(debounce, now_ns) do
    case count_restless(debounce, now_ns) do
      @most_restless ->
        :noise

      count ->
        {:wait, now_ns + debounce.window_ns, %{debounce | waiting?: true, restless: count}}
    end
  end

  @doc "Handles the level at the end of a window, and returns whether it has changed."
  @spec put_level(t(), integer(), 0 | 1) :: {:changed | :same, t()}
  def put_level(debounce, now_ns, level) do
    change = if level == debounce.level, do: :same, else: :changed
    {change, %{debounce | level: level, waiting?: false, rested_ns: now_ns}}
  end

  defp count_restless(%{rested_ns: nil}, _now_ns), do: 0

  defp count_restless(debounce, now_ns) do
    case div(now_ns - debounce.rested_ns, max(debounce.window_ns, @rest_ms * 1_000_000)) do
      0 -> debounce.restless + 1
      rests -> max(debounce.restless - rests, 0)
    end
  end
end
