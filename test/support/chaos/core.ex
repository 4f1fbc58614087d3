defmodule BB.Test.Chaos.Core do
  @moduledoc """
  The harness of `bin/chaos core`: kills any process and supervisor of two armed robots and of
  their application.

  Meanwhile parameters are set, traffic is recorded and processes vouch. It checks every
  guarantee.
  """

  alias BB.Test.Chaos.Core.{Robots, Traffic, Tree, Tuner, Verdict, Watch, Watchdog}
  alias Ganglion.Json

  @switches [kills: :integer, seed: :integer, json: :boolean]
  @kills 1_000
  @shown 20
  @patience_ms 10_000
  @look_ms 5
  @longest_pause_ms 60
  @told_every 100
  # A native program has a grace period, and its successor may find the topic taken.
  @late_ns 2_000_000_000
  # The harness restarts its own children without limit.
  @restarts [max_restarts: 1_000_000, max_seconds: 1]
  @own BB.Test.Chaos.Core.Supervisor
  @roots [Ganglion.Supervisor, BB.Safety.Supervisor, @own]

  @doc "Runs it with the arguments of the command line and halts the VM with its exit status."
  def main(argv) do
    case OptionParser.parse(argv, strict: @switches) do
      {opts, [], []} ->
        if positive?(opts[:kills]),
          do: opts |> run() |> System.halt(),
          else: refuse(["--kills #{opts[:kills]}"])

      {_, rest, wrong} ->
        refuse(rest ++ for({option, value} <- wrong, do: "#{option} #{value}"))
    end
  end

  defp positive?(count), do: count == nil or count > 0

  defp refuse(given) do
    IO.puts(
      :stderr,
      "chaos core: expected --kills N (from 1), --seed N or --json, " <>
        "got: #{Enum.join(given, " ")}"
    )

    System.halt(2)
  end

  defp run(opts) do
    # The kills are intended, and so are the log lines about them.
    Logger.configure(level: :none)
    Process.flag(:trap_exit, true)
    count = opts[:kills] || @kills
    seed = opts[:seed] || :rand.uniform(1_000_000)
    IO.puts("#{count} kills, seed #{seed}")
    _ = :rand.seed(:exsss, seed)

    folder = Path.join(System.tmp_dir!(), BB.Test.Run.unique("core"))
    File.mkdir_p!(folder)
    BB.Test.Brake.setup()
    Robots.define(folder)

    try do
      start() |> storm(count) |> finish() |> tell(opts)
    after
      end_robots()
      File.rm_rf!(folder)
      # A killed publisher has left its topic to a successor.
      topics = "/dev/shm/conduit_#{BB.Test.Run.name()}.#{System.pid()}.*"
      for topic <- Path.wildcard(topics), do: File.rm(topic)
    end
  end

  # Starting

  defp start do
    Application.put_env(:ganglion, :robot, Robots.inside())
    Application.put_env(:ganglion, :simulated_buses, Robots.buses())
    start_robots()
    {:ok, watch} = Watch.start_link(Robots.all())
    {values, tuners} = Tuner.start(Robots.all(), Robots.tuned())
    traffic = for robot <- Robots.all(), do: elem(Traffic.start_link(robot), 1)

    %{
      baseline: await(&all_up/0),
      watch: watch,
      values: values,
      tuners: tuners,
      traffic: traffic,
      began_ns: now_ns(),
      ledger: [],
      before: [],
      kills: 0,
      innocent: []
    }
  end

  defp start_robots do
    start_application()
    children = [Robots.outside() | for(robot <- Robots.all(), do: {Watchdog, robot})]
    {:ok, _} = Supervisor.start_link(children, [strategy: :one_for_one, name: @own] ++ @restarts)
    _ = await_armed()
  end

  defp stop_all do
    _ = stop_own()
    Application.stop(:ganglion)
  end

  defp stop_own do
    Supervisor.stop(@own)
  catch
    :exit, _gone -> :gone
  end

  defp all_up do
    rows = Enum.flat_map(Robots.all(), &BB.Sensor.health/1)
    if Enum.all?(rows, &(&1.state == :up)), do: complete([]), else: {:missing, rows}
  end

  defp start_application do
    {:ok, _} = Application.ensure_all_started(:ganglion)
  end

  # Killing

  defp storm(run, count) when run.kills >= count, do: run

  defp storm(run, count) do
    Process.sleep(:rand.uniform(@longest_pause_ms) - 1)
    run |> strike(count - run.kills) |> progress() |> storm(count)
  end

  # Several at once: the second is killed during the effects of the first death.
  defp strike(run, most) do
    tree = Tree.snapshot(@roots)
    victims = tree |> victims() |> Enum.take_random(min(Enum.random([1, 1, 1, 2, 3]), most))
    struck_ns = now_ns()
    for victim <- victims, do: kill(victim, tree)
    places = Enum.map(victims, &place/1)
    {expected, ledger} = Verdict.expected(tree, places, run.ledger, struck_ns)
    {later, missing} = settle(run.baseline)
    helpless = if missing == [], do: await_armed(), else: []

    # An end may be detected after the next kill.
    before = for {at_ns, places} <- run.before, struck_ns - at_ns < @late_ns, do: {at_ns, places}
    allowed = before |> Enum.take(1) |> Enum.reduce(expected, &MapSet.union(elem(&1, 1), &2))
    ended = Enum.reduce(before, expected, &MapSet.union(elem(&1, 1), &2))

    innocent =
      tree
      |> Verdict.innocent(later, allowed, &Robots.due?/3)
      |> Enum.reject(&Robots.late?(&1, ended, Map.keys(tree)))

    told = for what <- Enum.uniq(innocent ++ missing) ++ helpless, do: {run.kills, victims, what}

    run = %{
      run
      | ledger: ledger,
        before: [{struck_ns, expected} | before],
        kills: run.kills + length(victims),
        innocent: told ++ run.innocent
    }

    if missing == [] and helpless == [], do: run, else: start_anew(run)
  end

  # A process that did not return is reported once.
  defp start_anew(run) do
    _ = stop_all()
    start_robots()
    %{run | baseline: await(&all_up/0), before: [], ledger: []}
  end

  defp progress(%{kills: kills} = run) do
    if div(kills, @told_every) != div(run[:told] || 0, @told_every),
      do: IO.puts("#{kills} kills; #{length(run.innocent)} innocent restarts")

    Map.put(run, :told, kills)
  end

  # Every process but those of the harness, and the programs of native processes.
  defp victims(tree) do
    processes = for {place, _node} <- tree, place != [@own], do: place

    programs =
      for {place, node} <- tree,
          List.last(place) == :camera,
          program <- programs(node.pid),
          do: {:program, program, place}

    processes ++ programs
  end

  defp programs(pid) do
    {:links, links} = Process.info(pid, :links) || {:links, []}
    for port <- links, is_port(port), {:os_pid, os_pid} <- [Port.info(port, :os_pid)], do: os_pid
  end

  defp place({:program, _os_pid, place}), do: place
  defp place(place), do: place

  defp kill({:program, os_pid, _place}, _tree),
    do: System.cmd("kill", ["-9", to_string(os_pid)], stderr_to_stdout: true)

  defp kill(place, tree), do: Process.exit(tree[place].pid, :kill)

  # Waiting

  # Every process of the start runs again; the harness starts an application that has ended.
  defp settle(baseline) do
    case await(fn -> complete(Map.keys(baseline)) end) do
      {:missing, tree, places} -> {tree, places}
      tree -> {tree, []}
    end
  end

  defp complete(places) do
    start_application()
    tree = Tree.snapshot(@roots)
    missing = Enum.reject(places, &is_map_key(tree, &1))
    alive? = Enum.all?(tree, fn {_place, node} -> Process.alive?(node.pid) end)
    if missing == [] and alive?, do: {:ok, tree}, else: {:missing, tree, missing}
  end

  defp await(fun, until_ms \\ now_ms() + @patience_ms) do
    case fun.() do
      {:ok, result} -> result
      missing -> if now_ms() > until_ms, do: missing, else: again(fun, until_ms)
    end
  end

  defp again(fun, until_ms) do
    Process.sleep(@look_ms)
    await(fun, until_ms)
  end

  # The robots that cannot be armed.
  defp await_armed do
    for robot <- Robots.all(), {:missing, _} = helpless <- [await(fn -> armed(robot) end)] do
      helpless
    end
  end

  defp armed(robot) do
    arm(robot)
    if Watch.armed?(robot) and Watch.warden?(robot), do: {:ok, :armed}, else: {:missing, robot}
  end

  defp arm(robot) do
    if BB.Safety.state(robot) == :error, do: BB.Safety.force_disarm(robot)
    BB.Safety.arm(robot)
  rescue
    _not_running -> :not_running
  catch
    :exit, _gone -> :gone
  end

  # The end

  defp finish(run) do
    for pid <- [run.watch | run.tuners ++ run.traffic], do: true = Process.alive?(pid)
    Tuner.stop(run.tuners)
    {intervals, standstills} = Watch.report(run.watch)

    Map.merge(run, %{
      unwatched: Verdict.unwatched(intervals, standstills),
      traffic:
        run.traffic |> Enum.map(&Traffic.report/1) |> Enum.flat_map(&Map.values/1) |> Enum.sum(),
      acknowledged: Tuner.acknowledged(run.values),
      lost: run.values |> reread() |> Tuner.lost()
    })
  end

  # The values are read from disk, by robots that have not seen them before.
  defp reread(values) do
    end_robots()
    start_application()
    %{start: {module, function, args}} = Supervisor.child_spec(Robots.outside(), [])
    {:ok, _} = apply(module, function, args)
    values
  end

  defp end_robots do
    for robot <- Robots.all(), pid = Process.whereis(robot), do: Process.exit(pid, :kill)
    stop_all()
  end

  defp tell(run, opts) do
    show("armed without a warden", run.unwatched, fn {robot, from_ns, to_ns} ->
      "#{inspect(robot)}: #{ms(to_ns - from_ns)} ms, from #{ms(from_ns - run.began_ns)} ms on"
    end)

    show("lost values", run.lost, fn {{robot, path}, value, possible} ->
      "#{inspect(robot)} #{inspect(path)}: #{inspect(value)}, possible were #{inspect(possible)}"
    end)

    IO.puts("innocent restarts: #{length(run.innocent)}")

    for one <- run.innocent |> Enum.reverse() |> topmost() |> Enum.take(@shown),
        do: IO.puts("  " <> one)

    IO.puts(
      "#{run.acknowledged} values set, #{run.traffic} messages recorded, #{ms(now_ns() - run.began_ns)} ms"
    )

    result = %{
      kills: run.kills,
      armed_unwatched: length(run.unwatched),
      lost_values: length(run.lost),
      innocent_restarts: length(run.innocent)
    }

    if opts[:json], do: IO.puts(Json.encode(result))
    if Enum.all?(Map.delete(result, :kills), fn {_, n} -> n == 0 end), do: 0, else: 1
  end

  # The innocent restarts of each strike, without those below another one.
  defp topmost(innocent) do
    for {{kills, victims}, told} <-
          Enum.group_by(innocent, fn {kills, victims, _} -> {kills, victims} end),
        places = for({_, _, place} <- told, do: place),
        place <- places,
        not Enum.any?(places, &above?(&1, place)),
        do:
          "after #{kills} kills, by #{Enum.map_join(victims, ", ", &inspect/1)}: #{inspect(place)}"
  end

  defp above?(other, place),
    do: is_list(other) and is_list(place) and other != place and List.starts_with?(place, other)

  defp show(what, all, words) do
    IO.puts("#{what}: #{length(all)}")
    for one <- Enum.take(all, @shown), do: IO.puts("  " <> words.(one))
  end

  defp ms(ns), do: div(ns, 1_000_000)
  defp now_ms, do: System.monotonic_time(:millisecond)
  defp now_ns, do: System.monotonic_time(:nanosecond)
end
