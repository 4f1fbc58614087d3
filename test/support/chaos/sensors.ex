defmodule BB.Test.Chaos.Sensors do
  @moduledoc """
  The harness of `bin/chaos sensors`: breaks the wires of `Ganglion.Robots.All` at random, and
  checks every guarantee.
  """

  alias BB.Test.Chaos.{Intervals, Lane, Plan, Verdict}
  alias Ganglion.Json
  alias Ganglion.Robots.All

  @switches [faults: :integer, seed: :integer, json: :boolean]
  @faults 100
  @shown 10

  @doc "Runs it with the arguments of the command line and halts the VM with its exit status."
  def main(argv) do
    case OptionParser.parse(argv, strict: @switches) do
      {opts, [], []} -> opts |> run() |> System.halt()
      {_, rest, wrong} -> refuse(rest, wrong)
    end
  end

  defp refuse(rest, wrong) do
    given = rest ++ for({option, value} <- wrong, do: "#{option} #{value}")

    IO.puts(
      :stderr,
      "chaos sensors: expected --faults N, --seed N or --json, got: #{Enum.join(given, " ")}"
    )

    System.halt(2)
  end

  defp run(opts) do
    # The faults are intended, and so are the sensors' log lines about them.
    Logger.configure(level: :critical)
    {:ok, _} = Application.ensure_all_started(:ganglion)
    Process.flag(:trap_exit, true)
    count = opts[:faults] || @faults
    seed = opts[:seed] || :rand.uniform(1_000_000)
    IO.puts("#{count} faults, seed #{seed}")

    {:ok, _robot} = All.start_link()
    await_all_up(1_000)
    rows = BB.Sensor.health(All)
    before = BB.Test.Robot.supervisors(All)
    {:ok, intervals} = Intervals.start_link(All, Map.new(rows, &{&1.name, Verdict.worth_ns(&1)}))

    records = strike(Plan.new(All.World.places(), count, seed), count)

    {noted, standstills} = Intervals.report(intervals)
    result = judge(records, noted, standstills, rows, restarted(before))
    if opts[:json], do: IO.puts(Json.encode(result))
    if Enum.all?(Map.delete(result, :faults), fn {_, n} -> n == 0 end), do: 0, else: 1
  end

  defp await_all_up(0), do: raise("not all sensors are up: #{inspect(BB.Sensor.health(All))}")

  defp await_all_up(tries) do
    unless Enum.all?(BB.Sensor.health(All), &(&1.state == :up and &1.age_ns != nil)) do
      Process.sleep(10)
      await_all_up(tries - 1)
    end
  end

  defp strike(plan, count) do
    done = :counters.new(1, [])

    tell = fn _record ->
      :counters.add(done, 1, 1)
      struck = :counters.get(done, 1)
      if rem(struck, 100) == 0, do: IO.puts("#{struck} of #{count}")
    end

    plan
    |> Enum.map(fn {_lane, strikes} -> Task.async(fn -> Lane.run(All, strikes, tell) end) end)
    |> Task.await_many(:infinity)
    |> List.flatten()
  end

  # The supervisors and keepers that have restarted.
  defp restarted(before) do
    if Process.whereis(All), do: length(before -- BB.Test.Robot.supervisors(All)), else: 1
  end

  defp judge(records, noted, standstills, rows, restarted) do
    hidden = Verdict.hidden(records)
    late = Verdict.not_recovered(records, standstills)
    gaps = Verdict.gaps(noted, records, standstills, All.World.places(), rows)
    start_ns = records |> Enum.map(& &1.began_ns) |> Enum.min()
    show("hidden", hidden, &told(&1, start_ns))
    show("not recovered within a second", late, &told(&1, start_ns))

    show("gaps of siblings", gaps, fn {sensor, from, to} ->
      meanwhile = Verdict.meanwhile(records, All.World.places()[sensor], from, to)

      "#{sensor}: #{ms(to - from)} ms, from #{ms(from - start_ns)} ms on, while " <>
        Enum.map_join(meanwhile, "; ", &told(&1, start_ns))
    end)

    slowest = records |> Enum.filter(& &1.up_ns) |> Enum.sort_by(&(&1.ended_ns - &1.up_ns))
    show("slowest recoveries", Enum.take(slowest, 3), &told(&1, start_ns), 3)

    %{
      faults: length(records),
      robot_restarts: restarted,
      sibling_gaps: length(gaps),
      not_recovered: length(late),
      hidden: length(hidden)
    }
  end

  defp show(what, all, words, most \\ @shown) do
    IO.puts("#{what}: #{length(all)}")
    for one <- Enum.take(all, most), do: IO.puts("  " <> words.(one))
  end

  defp told(record, start_ns) do
    %{strike: strike} = record
    shown = if record.shown_ns, do: "shown after #{ms(record.shown_ns - record.began_ns)} ms"
    up = if record.up_ns, do: "up after #{ms(record.up_ns - record.ended_ns)} ms"

    "#{Enum.join(strike.sensors, " ")}: #{inspect(strike.fault)} at #{ms(record.began_ns - start_ns)} ms, " <>
      "#{shown || "never shown"}, lasted #{ms(record.ended_ns - record.began_ns)} ms, #{up || "never up"}"
  end

  defp ms(ns), do: div(ns, 1_000_000)
end
