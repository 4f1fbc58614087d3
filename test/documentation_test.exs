defmodule DocumentationTest do
  @moduledoc """
  Holds what the documentation promises: it is there, its links lead somewhere, and its examples
  run. What it has a reader type in a shell is for `test/first_steps_test.exs`.
  """

  use ExUnit.Case, async: true

  alias BB.Test.{DocBlocks, Run, Source}

  @documents ~w(README.md CONTRIBUTING.md CHANGELOG.md firmware/README.md docs/**/*.md native/**/README.md)
             |> Enum.flat_map(&Path.wildcard/1)

  # What config/host.exs says to a release: the robot that ships, on simulated buses.
  @console """
  Application.put_all_env(
    ganglion: [
      robot: Ganglion.Robot,
      simulated_buses: %{"i2c-1" => [devices: %{0x68 => {BB.Bus.Sim.Mpu6050, source: :motion}}]}
    ]
  )

  {:ok, _} = Application.ensure_all_started(:ganglion)
  {:ok, _} = BB.subscribe(Ganglion.Robot, [:sensor, :base_link, :imu])
  receive do: ({:bb, _, _} -> :ok)
  import Ganglion.Console
  """

  describe "a module" do
    test "says what it is, or that it is nobody's business" do
      assert for({module, :none, _docs} <- modules(), do: module) == []
    end

    test "that is documented documents all its functions, macros and callbacks" do
      undocumented =
        for {module, moduledoc, docs} <- modules(),
            is_map(moduledoc),
            {kind, name, arity} <- undocumented(docs),
            {name, arity} not in implemented(module),
            do: "#{kind} #{inspect(module)}.#{name}/#{arity}"

      assert undocumented == []
    end

    test "has no iex> example that nobody runs" do
      tests = "test/**/*_test.exs" |> Path.wildcard() |> Enum.map(&Source.read!/1)
      run = for test <- tests, {module, []} <- test.doctests, do: module
      shown = for {module, moduledoc, docs} <- modules(), examples?(moduledoc, docs), do: module

      for module <- shown,
          do: assert(module in run, "no test has `doctest #{inspect(module)}` without options")
    end
  end

  describe "a document" do
    for document <- @documents do
      test "#{document} has no link that leads nowhere" do
        for link <- links(unquote(document)), do: assert(File.exists?(link), "#{link} is missing")
      end

      test "#{document} names only commands that are there" do
        for command <- commands(unquote(document)),
            do: assert(command in executables(), "#{command} is named and is no command")
      end
    end

    test "has no iex> example, for which no test would run it" do
      assert Enum.filter(@documents, &(File.read!(&1) =~ "iex>")) == []
    end
  end

  test "every command in bin/ is documented and says how it is used" do
    assert executables() -- Enum.flat_map(@documents, &commands/1) == []

    for command <- executables() do
      assert {"usage: " <> usage, 0} =
               System.cmd(Path.expand(command), ["--help"], stderr_to_stdout: true)

      assert String.starts_with?(usage, command)
    end
  end

  test "the picture of the demonstration shows the robot that ships" do
    picture = File.read!("docs/images/demo.svg")

    for name <- Map.keys(Ganglion.Robot.robot().sensors),
        do: assert(picture =~ ">#{name}<", "#{name} is not in the picture")
  end

  test "the changelog has a section for what is not yet released" do
    assert File.read!("CHANGELOG.md") =~ ~r/^## \[?Unreleased\]?$/m
  end

  describe "the blocks of" do
    for document <- @documents do
      test "#{document} are of a known kind, and right as far as that shows without running" do
        blocks = DocBlocks.read!(unquote(document))
        assert Enum.flat_map(blocks, &DocBlocks.check(&1, File.cwd!())) == []
      end

      if document |> DocBlocks.read!() |> DocBlocks.select("elixir") != [] do
        test "#{document} in Elixir run one after the other" do
          blocks = unquote(document) |> DocBlocks.read!() |> DocBlocks.select("elixir")
          assert_runs(DocBlocks.run_elixir(blocks, File.cwd!(), env: environment()))
        end
      end
    end

    test "firmware/README.md for the console run on a robot's console" do
      blocks =
        "firmware/README.md" |> DocBlocks.read!() |> DocBlocks.select("elixir", ["console"])

      assert blocks != []
      opts = [env: environment(), mix: ["--no-start"], before: @console]
      output = assert_runs(DocBlocks.run_elixir(blocks, File.cwd!(), opts))
      assert output =~ ~r/^imu +up /m
      refute output =~ "went wrong"
    end
  end

  defp assert_runs({output, status}) do
    assert status == 0, output
    output
  end

  # Topics of another folder than those of robots that run on this machine.
  defp environment do
    topics = Path.join("/dev/shm", Run.unique("blocks"))
    File.mkdir!(topics)
    on_exit(fn -> File.rm_rf!(topics) end)
    [{"CONDUIT_RING_DIR", topics}, {"MIX_ENV", "test"}, {"LC_ALL", "C.UTF-8"}]
  end

  # Modules of the application: `{module, moduledoc, docs}`, where a moduledoc is a map of texts, :none or :hidden.

  defp modules do
    for module <- Application.spec(:ganglion, :modules),
        Code.ensure_loaded?(module),
        ours?(module),
        not function_exported?(module, :__impl__, 1) do
      {:docs_v1, _, _, _, moduledoc, _, docs} = Code.fetch_docs(module)
      {module, moduledoc, docs}
    end
  end

  defp ours?(module) do
    source = to_string(module.module_info(:compile)[:source])
    Path.relative_to_cwd(source) in Source.own()
  end

  # One arity that is documented speaks for the others of its name.
  defp undocumented(docs) do
    spoken_for = for {{kind, name, _}, _, _, doc, _} <- docs, doc != :none, do: {kind, name}

    for {{kind, name, arity}, _, _, :none, _} <- docs,
        kind in [:function, :macro, :callback, :macrocallback],
        {kind, name} not in spoken_for,
        do: {kind, name, arity}
  end

  defp implemented(module) do
    for {:behaviour, behaviours} <- module.module_info(:attributes),
        behaviour <- behaviours,
        callback <- behaviour.behaviour_info(:callbacks),
        do: callback
  end

  defp examples?(moduledoc, docs) do
    texts =
      for(doc <- [moduledoc | Enum.map(docs, &elem(&1, 3))], is_map(doc), do: Map.values(doc))

    texts |> List.flatten() |> Enum.any?(&(&1 =~ "iex>"))
  end

  # Documents

  defp links(document) do
    for [_, target] <- Regex.scan(~r/\]\(([^)\s]+)\)/, prose(document)),
        not (target =~ ~r/^([a-z]+:|#)/),
        [path | _] = String.split(target, "#"),
        do: document |> Path.dirname() |> Path.join(path)
  end

  defp commands(document) do
    for [command] <- Regex.scan(~r{(?<![\w./-])bin/[\w-]+}, File.read!(document)),
        uniq: true,
        do: command
  end

  defp executables do
    for file <- Path.wildcard("bin/*"), Bitwise.band(File.stat!(file).mode, 0o100) != 0, do: file
  end

  # What is code has brackets of its own.
  defp prose(document) do
    document
    |> File.read!()
    |> String.replace(~r/^```.*?^```/ms, "")
    |> String.replace(~r/`[^`\n]*`/, "")
  end
end
