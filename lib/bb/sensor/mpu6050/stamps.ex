defmodule BB.Sensor.Mpu6050.Stamps do
  @moduledoc """
  Converts the edges of the data-ready line into the times of samples, by the robot's clock.

  `BB.Sensor.Mpu6050.DataReady` keeps one. The module is pure.

      iex> alias BB.Sensor.Mpu6050.Stamps
      iex> stamps = Stamps.add_edge(Stamps.new(1_000_000), 7_000_000, 107_030_000)
      iex> stamps = Stamps.add_edge(stamps, 8_000_000, 108_010_000)
      iex> {:ok, times, _stamps} = Stamps.take(stamps, 2)
      iex> times
      [107_010_000, 108_010_000]

  The kernel has a clock of its own for the timestamps of edges. The message of an edge arrives
  after a varying delay. So the smallest difference between the two clocks in the last one or two
  seconds is the best estimate of their offset.

  ## Which edge belongs to which sample

  Samples in the FIFO and edges come in the same order, one for one, unless an edge is lost or
  noise makes one. So

  - as many edges as samples belong to them in order;
  - with one sample more than edges, the edge of the last sample is still to come, and the sample
    waits. When this was so eight times in a row, an edge was lost;
  - with more samples, the edges belong to the last ones, and the samples before them get times by
    the sample period;
  - with more edges than samples, the last edges count. Eight too many are `:noise`.
  """

  @window_ns 1_000_000_000
  @most_unpaired 8

  @enforce_keys [:period_ns]
  defstruct [:period_ns, :last_ns, :window, :before, edges: [], late: 0]

  @typedoc """
  The edges of a chip.

  - `:edges`: their kernel times, the newest first;
  - `:late`: how often in a row an edge was still to come;
  - `:last_ns`: the time of the last sample;
  - `:window`: the start of the current window and the smallest difference of the clocks in it;
  - `:before`: the smallest difference in the window before.
  """
  @type t :: %__MODULE__{
          period_ns: pos_integer(),
          edges: [integer()],
          late: non_neg_integer(),
          last_ns: integer() | nil,
          window: {integer(), integer()} | nil,
          before: integer() | nil
        }

  @doc "Returns the state of a chip that samples each `period_ns`."
  @spec new(pos_integer()) :: t()
  def new(period_ns), do: %__MODULE__{period_ns: period_ns}

  @doc "Adds an edge with the kernel's time `edge_ns`, which arrived at `now_ns`."
  @spec add_edge(t(), integer(), integer()) :: t()
  def add_edge(stamps, edge_ns, now_ns) do
    {window, before} = update_window(stamps, now_ns - edge_ns, now_ns)
    %{stamps | edges: [edge_ns | stamps.edges], window: window, before: before}
  end

  @doc "Returns the time of the last edge, and drops all edges."
  @spec take_last(t()) :: {integer(), t()}
  def take_last(%{edges: [edge_ns | _]} = stamps) do
    {[time_ns], stamps} = to_clock(stamps, [edge_ns])
    {time_ns, stamps}
  end

  @doc "Returns the times of the oldest of `count` samples, of as many as have an edge."
  @spec take(t(), non_neg_integer()) :: {:ok, [integer()], t()} | :noise
  def take(%{edges: []} = stamps, _count), do: {:ok, [], stamps}

  def take(%{edges: edges, late: late} = stamps, count) do
    case count - length(edges) do
      more when more < -@most_unpaired -> :noise
      more when more <= 0 -> put_late(stamps, Enum.take(edges, count), 0)
      1 when late < @most_unpaired -> put_late(stamps, edges, late + 1)
      more -> put_late(stamps, edges ++ earlier(List.last(edges), stamps.period_ns, more), 0)
    end
  end

  defp earlier(first_ns, period_ns, count), do: for(n <- 1..count, do: first_ns - n * period_ns)

  defp put_late(stamps, edges, late) do
    {times, stamps} = to_clock(%{stamps | late: late}, edges)
    {:ok, times, stamps}
  end

  # Times increase, also when the estimate of the offset gets better.
  defp to_clock(stamps, edges) do
    offset_ns = offset_ns(stamps)

    {times, last_ns} =
      edges
      |> Enum.reverse()
      |> Enum.map_reduce(stamps.last_ns, fn edge_ns, last_ns ->
        time_ns = later(edge_ns + offset_ns, last_ns)
        {time_ns, time_ns}
      end)

    {times, %{stamps | edges: [], last_ns: last_ns}}
  end

  defp later(time_ns, nil), do: time_ns
  defp later(time_ns, last_ns), do: max(time_ns, last_ns + 1)

  # The offset of the clocks.

  defp update_window(%{window: nil}, difference, now_ns), do: {{now_ns, difference}, difference}

  defp update_window(%{window: {start_ns, smallest}} = stamps, difference, now_ns) do
    if now_ns - start_ns >= @window_ns,
      do: {{now_ns, difference}, smallest},
      else: {{start_ns, min(smallest, difference)}, stamps.before}
  end

  defp offset_ns(%{window: {_start_ns, smallest}, before: before}), do: min(smallest, before)
end
