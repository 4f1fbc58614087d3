defmodule NewTest do
  @moduledoc """
  Makes a robot's project as a person does: `bin/new`, `bin/demo`, `bin/test` and a release,
  outside of the repository, with Ganglion by path and by git. `bin/test new` runs this test; `mix
  test` skips it, because it builds everything again.
  """

  use ExUnit.Case, async: false

  import BB.Test.Eventually

  alias BB.Test.{Native, Project, Run}

  @moduletag :new
  @moduletag timeout: 1_800_000

  setup do
    folder = Path.join(System.tmp_dir!(), Run.unique("new"))
    topics = Path.join("/dev/shm", Run.unique("new"))
    for dir <- [folder, topics], do: File.mkdir!(dir)
    on_exit(fn -> for dir <- [folder, topics], do: File.rm_rf!(dir) end)
    %{folder: folder, topics: topics, rover: Path.join(folder, "rover")}
  end

  # The project shares the crates that this checkout has built: the same sources at the same path.
  test "a robot by path runs at once, passes its tests, and runs as a release", place do
    place = Map.put(place, :how, :path)
    new(place, [])

    assert_demo(place)
    run!(place, "bin/test")
    run!(place, "mix", ~w(format --check-formatted))
    run!(place, "mix", ~w(compile --force --warnings-as-errors))
    assert_release(place)
    assert File.ls!(place.topics) == []
  end

  test "a robot by git runs at once and passes its tests", place do
    origin = Path.join(place.folder, "origin")
    place = Map.put(place, :how, :git)
    new(place, ["--from", "git:" <> Project.clone!(origin)])

    assert_demo(place)
    run!(place, "bin/test")
    run!(place, "mix", ~w(compile --force --warnings-as-errors))
    assert File.read!(Path.join(place.rover, "mix.lock")) =~ "ganglion"
    assert File.ls!(place.topics) == []
  end

  # The commands of a person, in their order.

  defp new(place, options) do
    empty = Path.join(place.folder, "empty")
    File.mkdir!(empty)
    said = run!(%{place | rover: empty}, Path.expand("bin/new"), ["../rover" | options])
    assert said =~ "Rover is in"
    assert File.ls!(empty) == []
  end

  defp assert_demo(place) do
    said = run!(place, "bin/demo", ~w(--seconds 10 --json))

    summary =
      said |> String.split("\n", trim: true) |> Enum.filter(&(&1 =~ ~r/^{/)) |> List.last()

    for sensor <- ~w(imu temperature ranger ranger_inlet) do
      assert summary =~ ~r/"#{sensor}":{[^}]*"published":[1-9]\d*[^}]*"state":"up"}/, said
    end
  end

  defp assert_release(place) do
    run!(place, "mix", ~w(release --quiet), [{"MIX_ENV", "prod"}])
    rover = Path.join(place.rover, "_build/prod/rel/rover/bin/rover")
    node = [{"RELEASE_NODE", String.replace(Run.unique("rover"), ".", "_")}]

    run!(place, rover, ["daemon"], node)
    os_pid = eventually(fn -> pid(place, rover, node) end)
    on_exit(fn -> Native.end_by_force(os_pid) end)

    # The console's robot is the configured one.
    for sensor <- ~w(imu temperature ranger) do
      eventually(fn ->
        {said, _} = run(place, rover, ["rpc", "Ganglion.Console.sensors()"], node)
        said =~ ~r/^#{sensor} +up +\d+\.\d/m
      end)
    end

    eventually(fn ->
      {said, _} = run(place, rover, ["rpc", "Ganglion.Console.topics()"], node)
      said =~ "sensor/base_link/ranger" and said =~ "sensor/base_link/temperature"
    end)

    run!(place, rover, ["stop"], node)
    eventually(fn -> not Native.running?(os_pid) end)
  end

  defp pid(place, rover, node) do
    with {text, 0} <- run(place, rover, ["pid"], node),
         do: text |> String.trim() |> String.to_integer(),
         else: (_not_yet -> nil)
  end

  defp run!(place, command, arguments \\ [], env \\ []) do
    {said, status} = run(place, command, arguments, env)
    assert status == 0, "#{command} #{Enum.join(arguments, " ")} ended with #{status}:\n#{said}"
    said
  end

  defp run(place, command, arguments, env) do
    command = if command =~ "/", do: Path.expand(command, place.rover), else: command
    env = [{"CONDUIT_RING_DIR", place.topics} | env]
    place.rover |> Project.in_folder(place.how) |> Project.run(command, arguments, env)
  end
end
