defmodule BB.Sensor.QuadratureEncoder.Counter do
  @moduledoc """
  Counts the edges of two lines that are a quarter of a period apart, and measures their rate.

  `BB.Sensor.QuadratureEncoder` keeps one. The module is pure.

      iex> alias BB.Sensor.QuadratureEncoder.Counter
      iex> counter = Counter.edge(Counter.new(), 0b01, 0b00, 1_000)
      iex> counter = Counter.edge(counter, 0b11, 0b01, 1_001_000)
      iex> counter.count
      2
      iex> {rate, _counter} = Counter.rate(counter, 0.02)
      iex> rate
      1000.0

  A value has line A in bit 0 and line B in bit 1. Forwards, A leads: 00, 01, 11, 10 (B left, A
  right), four counts a period. The rate is measured between the timestamps of edges, so the time
  of a reading and a slow reader do not change it. While no edge comes, it is at most the rate
  that one edge now would have, and 0 after half a second.
  """
  import Bitwise

  defstruct count: 0,
            line: nil,
            run: 0,
            edges: 0,
            missed: 0,
            first: nil,
            last: nil,
            reference: nil,
            quiet_s: 0.0,
            rate: 0.0

  @typedoc "An edge: its timestamp, and the count after it."
  @type mark :: {time_ns :: integer(), count :: integer()}

  @typedoc """
  A counter.

  - `:run`: the number of edges in a row that came from `:line`;
  - `:edges`, `:missed`, `:first`, `:last`: edges since the last reading;
  - `:reference`: the last edge before that reading.
  """
  @type t :: %__MODULE__{
          count: integer(),
          line: :a | :b | nil,
          run: non_neg_integer(),
          edges: non_neg_integer(),
          missed: non_neg_integer(),
          first: mark() | nil,
          last: mark() | nil,
          reference: mark() | nil,
          quiet_s: float(),
          rate: float()
        }

  @typedoc """
  A fault, which no wheel causes:

  - `{:one_line, line}`: 100 edges in a row came from one line. The wire of the other line is
    broken, or this line has noise;
  - `:missed`: more than one edge in ten is lost.
  """
  @type fault :: {:one_line, :a | :b} | :missed

  @still_s 0.5
  @longest_run 100
  @few 3

  @doc "Returns a counter at 0."
  @spec new() :: t()
  def new, do: %__MODULE__{}

  @doc "Counts an edge, from the value `previous` to `value`."
  @spec edge(t(), 0..3, 0..3, integer()) :: t()
  def edge(counter, value, previous, time_ns) do
    case steps(value, previous) do
      0 -> %{counter | edges: counter.edges + 1, missed: counter.missed + 1}
      steps -> counter |> count_run(bxor(value, previous)) |> step(steps, time_ns)
    end
  end

  @doc "Returns the counts a second at a reading, `dt_s` seconds after the last one."
  @spec rate(t(), float()) :: {float(), t()}
  def rate(%{last: nil} = counter, dt_s) do
    quiet_s = counter.quiet_s + dt_s
    rate = if quiet_s >= @still_s, do: 0.0, else: limit(counter.rate, 1 / max(quiet_s, 1.0e-9))
    {rate, %{counter | rate: rate, quiet_s: quiet_s, edges: 0, missed: 0}}
  end

  def rate(counter, _dt_s) do
    rate = counter |> first_mark() |> rate_between(counter.last, counter.rate)
    reset = %{counter | rate: rate, quiet_s: 0.0, edges: 0, missed: 0, first: nil, last: nil}
    {rate, %{reset | reference: counter.last}}
  end

  @doc "Returns the fault of the edges, or `nil`."
  @spec fault(t()) :: fault() | nil
  def fault(%{run: run, line: line}) when run >= @longest_run, do: {:one_line, line}

  def fault(%{edges: edges, missed: missed}) when missed >= @few and missed * 10 > edges,
    do: :missed

  def fault(_counter), do: nil

  # By the places of the values in their order.
  defp steps(value, previous) do
    case place(value) - place(previous) &&& 3 do
      3 -> -1
      2 -> 0
      steps -> steps
    end
  end

  defp place(0b00), do: 0
  defp place(0b01), do: 1
  defp place(0b11), do: 2
  defp place(0b10), do: 3

  defp count_run(counter, changed) do
    line = if changed == 0b01, do: :a, else: :b

    if line == counter.line,
      do: %{counter | run: counter.run + 1},
      else: %{counter | line: line, run: 1}
  end

  defp step(counter, steps, time_ns) do
    count = counter.count + steps
    mark = {time_ns, count}
    %{counter | count: count, edges: counter.edges + 1, first: counter.first || mark, last: mark}
  end

  # An edge before a standstill is used only when it is the only other one.
  defp first_mark(%{reference: nil, first: first}), do: first
  defp first_mark(%{quiet_s: quiet_s, reference: reference}) when quiet_s == 0.0, do: reference
  defp first_mark(%{first: first, last: first, reference: reference}), do: reference
  defp first_mark(%{first: first}), do: first

  defp rate_between({from_ns, from}, {to_ns, to}, _rate) when to_ns > from_ns,
    do: (to - from) * 1.0e9 / (to_ns - from_ns)

  defp rate_between(_from, _to, rate), do: rate

  defp limit(rate, most), do: rate |> min(most) |> max(-most)
end
