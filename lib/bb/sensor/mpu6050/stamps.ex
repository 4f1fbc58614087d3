defmodule BB.Sensor.Mpu6050.Stamps do
  @moduledoc """
  When samples were taken: the edges of the data-ready line, as times of the robot's clock, each to its sample. Pure.

  The kernel stamps an edge with a clock of its own. An edge is heard a little after it happened, now sooner, now later, so the smallest
  difference between the two clocks in the last one or two seconds is nearest to the truth.

      iex> alias BB.Sensor.Mpu6050.Stamps
      iex> stamps = Stamps.new(1_000_000) |> Stamps.heard(7_000_000, 107_030_000) |> Stamps.heard(8_000_000, 108_010_000)
      iex> {:ok, times, _stamps} = Stamps.pair(stamps, 2)
      iex> times
      [107_010_000, 108_010_000]

  ## Which edge is whose
  Samples in the FIFO and edges come in the same order, one for one, unless an edge is lost or noise makes one. So

  - as many edges as samples belong to them in order;
  - one sample more than edges has its edge still to come, and waits for that; when it has been so eight times in a row an edge was lost;
  - of more samples the last ones have the edges, and those before them the times that the sample period gives;
  - of more edges than samples the last ones count. Eight too many are `:noise`.
  """

  @window_ns 1_000_000_000
  @patience 8

  @enforce_keys [:period_ns]
  defstruct [:period_ns, :last_ns, :window, :before, edges: [], late: 0]

  @typedoc "`edges` are the kernel's times, newest first; `window` is `{start, smallest difference}`, `before` that of the window before."
  @type t :: %__MODULE__{
          period_ns: pos_integer(),
          edges: [integer()],
          late: non_neg_integer(),
          last_ns: integer() | nil,
          window: {integer(), integer()} | nil,
          before: integer() | nil
        }

  @doc "Those of a chip that takes a sample each `period_ns`."
  @spec new(pos_integer()) :: t()
  def new(period_ns), do: %__MODULE__{period_ns: period_ns}

  @doc "An edge of the kernel's time `edge_ns` was heard at `now_ns`."
  @spec heard(t(), integer(), integer()) :: t()
  def heard(stamps, edge_ns, now_ns) do
    {window, before} = compare(stamps, now_ns - edge_ns, now_ns)
    %{stamps | edges: [edge_ns | stamps.edges], window: window, before: before}
  end

  @doc "The time of the last edge, which makes those before it pointless."
  @spec last(t()) :: {integer(), t()}
  def last(%{edges: [edge_ns | _]} = stamps) do
    {[time_ns], stamps} = settle(stamps, [edge_ns])
    {time_ns, stamps}
  end

  @doc "The times of the oldest of `count` samples, of as many as have one."
  @spec pair(t(), non_neg_integer()) :: {:ok, [integer()], t()} | :noise
  def pair(%{edges: []} = stamps, _count), do: {:ok, [], stamps}

  def pair(%{edges: edges, late: late} = stamps, count) do
    case count - length(edges) do
      more when more < -@patience -> :noise
      more when more <= 0 -> given(stamps, Enum.take(edges, count), 0)
      1 when late < @patience -> given(stamps, edges, late + 1)
      more -> given(stamps, edges ++ missed(List.last(edges), stamps.period_ns, more), 0)
    end
  end

  defp missed(first_ns, period_ns, count), do: for(n <- 1..count, do: first_ns - n * period_ns)

  defp given(stamps, edges, late) do
    {times, stamps} = settle(%{stamps | late: late}, edges)
    {:ok, times, stamps}
  end

  # Two samples never have one time, also where the clocks are compared better than before.
  defp settle(stamps, edges) do
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

  # Comparing the clocks.

  defp compare(%{window: nil}, difference, now_ns), do: {{now_ns, difference}, difference}

  defp compare(%{window: {start_ns, smallest}} = stamps, difference, now_ns) do
    if now_ns - start_ns >= @window_ns,
      do: {{now_ns, difference}, smallest},
      else: {{start_ns, min(smallest, difference)}, stamps.before}
  end

  defp offset_ns(%{window: {_start_ns, smallest}, before: before}), do: min(smallest, before)
end
