defmodule BB.Test.Chaos.Soak do
  @moduledoc """
  The harness of `bin/chaos soak`: runs the demonstration and the host's release for a while, and
  checks that their resources do not grow.
  """

  alias BB.Test.Chaos.Soak.{Subject, Trend}
  alias BB.Test.Run
  alias Ganglion.Json

  @switches [seconds: :integer, json: :boolean]
  @seconds 600
  @least_seconds 30
  # The warm-up: loading, opening and caching at the start is no trend.
  @warm_up 0.2
  @start_s 300
  @told_every_s 60

  # The allowed growth, absolute or relative. Allocators and garbage need some time to settle.
  @allowed %{
    "memory" => {2_000_000, 0.02},
    "ets_memory" => {262_144, 0.02},
    "ets_tables" => {0.5, 0.0},
    "atoms" => {20, 0.0},
    "ports" => {0.5, 0.0},
    "processes" => {1, 0.0},
    "threads" => {0.5, 0.0},
    "descriptors" => {0.5, 0.0},
    "rss" => {8_000_000, 0.03},
    "native_rss" => {4_000_000, 0.03},
    "native_processes" => {0.5, 0.0},
    "shm" => {0.5, 0.0}
  }

  @doc "Runs it with the arguments of the command line and halts the VM with its exit status."
  def main(argv) do
    case OptionParser.parse(argv, strict: @switches) do
      {opts, [], []} -> opts |> Keyword.put_new(:seconds, @seconds) |> check() |> System.halt()
      {_, rest, wrong} -> refuse(rest ++ for({option, value} <- wrong, do: "#{option} #{value}"))
    end
  end

  defp check(opts) do
    if opts[:seconds] < @least_seconds,
      do: refuse(["--seconds #{opts[:seconds]}"]),
      else: run(opts)
  end

  defp refuse(given) do
    IO.puts(
      :stderr,
      "chaos soak: expected --seconds N (from #{@least_seconds}) or --json, " <>
        "got: #{Enum.join(given, " ")}"
    )

    System.halt(2)
  end

  defp run(opts) do
    folder = Path.join(System.tmp_dir!(), Run.unique("release"))

    try do
      build_release(folder)
      subjects = start(folder)

      try do
        Enum.each(subjects, &await_start/1)
        subjects |> watch(opts[:seconds]) |> judge() |> tell(opts)
      after
        Enum.each(subjects, &Subject.stop/1)
      end
    after
      File.rm_rf!(folder)
    end
  end

  defp build_release(folder) do
    build = [env: [{"MIX_ENV", "prod"}, {"MIX_BUILD_PATH", nil}], stderr_to_stdout: true]

    case System.cmd("mix", ["release", "--quiet", "--path", folder], build) do
      {_said, 0} -> :ok
      {said, status} -> raise "mix release ended with #{status}:\n#{said}"
    end
  end

  defp start(folder) do
    node = String.replace(Run.unique("soak"), ".", "_")
    release = [{"RELEASE_NODE", node}, {"RELEASE_TMP", Path.join(folder, "tmp")}]

    [
      Subject.start("demo", [Path.expand("bin/demo"), "--json"]),
      Subject.start("release", [Path.join(folder, "bin/ganglion"), "start"], release)
    ]
  end

  # Waits until the robot's native programs run, and with them all processes below them.
  defp await_start(subject, left_s \\ @start_s) do
    cond do
      match?(%{"native_processes" => n} when n >= 4, Subject.figures(subject)) ->
        :ok

      left_s == 0 or not Subject.running?(subject) ->
        raise "#{subject.name} does not start:\n#{Subject.log(subject)}"

      true ->
        Process.sleep(1_000)
        await_start(subject, left_s - 1)
    end
  end

  defp watch(subjects, seconds), do: watch(subjects, 0, seconds, [])

  defp watch(_subjects, second, seconds, taken) when second > seconds, do: Enum.reverse(taken)

  defp watch(subjects, second, seconds, taken) do
    figures = Map.new(subjects, &{&1.name, taken(&1)})

    if rem(second, @told_every_s) == 0,
      do: IO.puts("second #{second}: " <> Enum.map_join(figures, "; ", &line/1))

    Process.sleep(1_000)
    watch(subjects, second + 1, seconds, [{second, figures} | taken])
  end

  defp taken(subject) do
    unless Subject.running?(subject),
      do: raise("#{subject.name} has ended:\n#{Subject.log(subject)}")

    Subject.figures(subject)
  end

  defp line({name, figures}) do
    "#{name} " <>
      Enum.map_join(~w(memory rss threads descriptors atoms), ", ", &"#{&1} #{figures[&1]}")
  end

  # `%{subject => %{figure => %{median, gain, flat?}}}`.
  defp judge(taken) do
    warm = Enum.drop(taken, round(length(taken) * @warm_up))

    for {name, figures} <- elem(hd(warm), 1), into: %{} do
      {name, Map.new(figures, fn {figure, _value} -> {figure, trend(warm, name, figure)} end)}
    end
  end

  defp trend(taken, name, figure) do
    samples = for {second, figures} <- taken, do: {second, figures[name][figure]}
    {floor, share} = Map.fetch!(@allowed, figure)

    %{
      median: Trend.middle(samples),
      gain: round(Trend.gain(samples)),
      flat: Trend.flat?(samples, floor, share)
    }
  end

  defp tell(verdict, opts) do
    for {name, figures} <- verdict, {figure, trend} <- Enum.sort(figures) do
      flat = if trend.flat, do: "flat", else: "NOT FLAT"
      IO.puts("#{name} #{figure}: median #{trend.median}, gained #{trend.gain}: #{flat}")
    end

    rising = for {_, figures} <- verdict, {_, %{flat: false}} <- figures, do: :rising

    if opts[:json],
      do:
        IO.puts(
          Json.encode(
            Map.merge(verdict, %{"seconds" => opts[:seconds], "not_flat" => length(rising)})
          )
        )

    if rising == [], do: 0, else: 1
  end
end
