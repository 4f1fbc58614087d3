defmodule BB.Test.Chaos.Verdict do
  @moduledoc """
  Decides whether the guarantees were kept, from the records of the lanes and the listener. Pure;
  times in nanoseconds.

  Time in which the whole VM stood still is subtracted.
  """

  alias BB.Test.Chaos.{Plan, Wires}

  @recovery_ns 1_000_000_000
  # The delay of a busy machine in addition to the recorded standstills.
  @slack_ns 15_000_000
  @ns_per_ms 1_000_000
  # The transfers of one reading, if it has several: the TF-Luna is read until two results are
  # equal.
  @transfers %{lidar: 2}

  @doc """
  Returns the minimum length of a recorded interval of a sensor: two periods, because a late
  reading may miss its next deadline.
  """
  def worth_ns(row), do: round(2.0e9 / row.declared_hz) + @slack_ns

  @doc "Returns the strikes that health never showed."
  def hidden(records), do: Enum.filter(records, &(&1.shown_ns == nil))

  @doc "Returns the strikes after which a sensor was not up within a second."
  def not_recovered(records, standstills) do
    Enum.filter(records, fn record ->
      record.up_ns == nil or
        record.up_ns - record.ended_ns - overlap(standstills, record.ended_ns, record.up_ns) >
          @recovery_ns
    end)
  end

  @doc """
  Returns the intervals of unaffected sensors that are longer than their periods and the transfers
  of others explain.
  """
  def gaps(intervals, records, standstills, places, rows) do
    worth_ns = Map.new(rows, &{&1.name, worth_ns(&1)})

    for {sensor, all} <- intervals,
        {from, to} <- all,
        not concerned?(sensor, from, to, records),
        excess = to - from - worth_ns[sensor],
        excess - shared_ns(sensor, places[sensor], from, to, records) -
          overlap(standstills, from, to) > 0,
        do: {sensor, from, to}
  end

  defp concerned?(sensor, from, to, records) do
    Enum.any?(records, fn record ->
      sensor in record.strike.sensors and record.began_ns < to and record.heard_ns > from
    end)
  end

  # For each transfer of its own, one of each failing device on the same wires in that time.
  defp shared_ns(_sensor, nil, _from, _to, _records), do: 0

  defp shared_ns(sensor, place, from, to, records) do
    for record <- meanwhile(records, place, from, to), reduce: 0 do
      ns ->
        ns + Map.get(@transfers, sensor, 1) * Wires.holds_ms(record.strike.fault) * @ns_per_ms
    end
  end

  @doc "The strikes on the same wires in that time."
  def meanwhile(records, place, from, to) do
    Enum.filter(records, fn record ->
      Plan.lane(record.strike.place) == Plan.lane(place) and
        record.began_ns < to and record.ended_ns > from
    end)
  end

  @doc """
  Returns how long the VM, or one of its schedulers, stood still between `from` and `to`.

      iex> BB.Test.Chaos.Verdict.overlap([{30, 40}, {10, 20}, {15, 18}], 15, 35)
      10
  """
  def overlap(standstills, from, to) do
    {ns, _until} =
      standstills
      |> Enum.map(fn {a, b} -> {max(a, from), min(b, to)} end)
      |> Enum.sort()
      |> Enum.reduce({0, from}, fn {a, b}, {ns, until} ->
        {ns + max(b - max(a, until), 0), max(b, until)}
      end)

    ns
  end
end
