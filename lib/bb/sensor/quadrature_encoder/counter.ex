defmodule BB.Sensor.QuadratureEncoder.Counter do
  @moduledoc """
  Counts the edges of two lines a quarter of a period apart, and tells how fast they come. Pure.

  A value has line A in bit 0 and line B in bit 1. Forwards, A leads: 00, 01, 11, 10 (B left, A right), four counts a period. The rate
  is that between time stamps of edges, so that neither the moment of looking nor a slow reader falsifies it; while no edge comes
  it is at most what a single edge now would make it, and after half a second 0.

      iex> alias BB.Sensor.QuadratureEncoder.Counter
      iex> counter = Counter.new() |> Counter.edge(0b01, 0b00, 1_000) |> Counter.edge(0b11, 0b01, 1_001_000)
      iex> counter.count
      2
      iex> {rate, _counter} = Counter.rate(counter, 0.02)
      iex> rate
      1000.0
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

  @typedoc "An edge: its time stamp, and the count after it."
  @type mark :: {time_ns :: integer(), count :: integer()}

  @typedoc """
  `run` edges in a row were of `line`. `edges` and `missed`, `first` and `last` are of the time since the last look; `reference` is
  the last edge before it.
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
  What cannot be a wheel:

  - `{:one_line, line}`: #{100} edges in a row came from one line: the other's wire is broken, or this one has noise;
  - `:missed`: edges are lost, more than one in ten.
  """
  @type fault :: {:one_line, :a | :b} | :missed

  @still_s 0.5
  @longest_run 100
  @few 3

  @doc "Nothing counted yet."
  @spec new() :: t()
  def new, do: %__MODULE__{}

  @doc "An edge, with the value after it and the one before."
  @spec edge(t(), 0..3, 0..3, integer()) :: t()
  def edge(counter, value, previous, time_ns) do
    case steps(value, previous) do
      0 -> %{counter | edges: counter.edges + 1, missed: counter.missed + 1}
      steps -> counter |> ran(bxor(value, previous)) |> step(steps, time_ns)
    end
  end

  @doc "Counts a second at the time of a look, `dt_s` seconds after the one before."
  @spec rate(t(), float()) :: {float(), t()}
  def rate(%{last: nil} = counter, dt_s) do
    quiet_s = counter.quiet_s + dt_s
    rate = if quiet_s >= @still_s, do: 0.0, else: limit(counter.rate, 1 / max(quiet_s, 1.0e-9))
    {rate, %{counter | rate: rate, quiet_s: quiet_s, edges: 0, missed: 0}}
  end

  def rate(counter, _dt_s) do
    rate = counter |> from() |> between(counter.last, counter.rate)
    looked = %{counter | rate: rate, quiet_s: 0.0, edges: 0, missed: 0}
    {rate, %{looked | reference: counter.last, first: nil, last: nil}}
  end

  @doc "What is wrong with what was counted, or `nil`."
  @spec fault(t()) :: fault() | nil
  def fault(%{run: run, line: line}) when run >= @longest_run, do: {:one_line, line}

  def fault(%{edges: edges, missed: missed}) when missed >= @few and missed * 10 > edges,
    do: :missed

  def fault(_counter), do: nil

  # The places of the values in the order in which they come.
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

  defp ran(counter, changed) do
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

  # After a standstill the edge before it says nothing, unless there is no other.
  defp from(%{reference: nil, first: first}), do: first
  defp from(%{quiet_s: quiet_s, reference: reference}) when quiet_s == 0.0, do: reference
  defp from(%{first: first, last: first, reference: reference}), do: reference
  defp from(%{first: first}), do: first

  defp between({from_ns, from}, {to_ns, to}, _rate) when to_ns > from_ns,
    do: (to - from) * 1.0e9 / (to_ns - from_ns)

  defp between(_from, _to, rate), do: rate

  defp limit(rate, most), do: rate |> min(most) |> max(-most)
end
