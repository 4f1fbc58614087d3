defmodule DocumentationTest do
  @moduledoc """
  Holds what the documentation promises: it is complete, its links resolve, its examples run, and
  its sentences have the form that `BB.Test.Prose` can judge. Shell blocks are for
  `test/first_steps_test.exs`.
  """

  use ExUnit.Case, async: true

  doctest BB.Test.Prose

  alias BB.Test.{DocBlocks, Prose, Run, Source}

  @documents ~w(README.md CONTRIBUTING.md CHANGELOG.md firmware/README.md docs/**/*.md native/**/README.md
                packages/*/README.md)
             |> Enum.flat_map(&Path.wildcard/1)

  @sources [
    "mix.exs",
    ".formatter.exs",
    "{bench,config,examples,lib}/**/*.{ex,exs}",
    "packages/*/{mix,.formatter}.exs",
    "packages/*/lib/**/*.ex"
  ]

  # The configuration of a release from config/host.exs: the robot that ships, on simulated buses.
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
    test "has a moduledoc or `@moduledoc false`" do
      assert_none(for {module, :none, _docs, _meta} <- modules(), do: inspect(module))
    end

    test "with a moduledoc documents its functions, macros and callbacks" do
      assert_none(
        for {module, moduledoc, docs, _meta} <- modules(),
            is_map(moduledoc),
            {kind, name, arity} <- undocumented(docs),
            {name, arity} not in implemented(module),
            do: "#{kind} #{inspect(module)}.#{name}/#{arity} has no @doc"
      )
    end

    test "with a moduledoc has a @spec for each of its functions" do
      assert_none(
        for {module, moduledoc, docs, _meta} <- modules(),
            is_map(moduledoc),
            {name, arity} <- unspecified(module, docs),
            do: "#{inspect(module)}.#{name}/#{arity} has no @spec"
      )
    end

    test "shows an example in its moduledoc, or says in `@moduledoc no_example:` why not" do
      assert_none(
        for {module, %{"en" => text}, _docs, meta} <- modules(),
            not Prose.example?(text),
            not reason?(meta[:no_example]),
            do: "#{inspect(module)} has no example and no `@moduledoc no_example: \"reason\"`"
      )
    end

    test "begins each doc with a sentence that ends with a full stop" do
      assert_none(
        for {module, moduledoc, docs, _meta} <- modules(),
            {name, %{"en" => text}} <- [{"the moduledoc", moduledoc} | texts(docs)],
            not Prose.first_sentence?(text),
            do: "#{inspect(module)}, #{name}: #{text |> String.split("\n") |> hd()}"
      )
    end

    test "has no iex> example without a doctest" do
      tests = "test/**/*_test.exs" |> Path.wildcard() |> Enum.map(&Source.read!/1)
      run = for test <- tests, {module, []} <- test.doctests, do: module

      shown =
        for {module, moduledoc, docs, _meta} <- modules(), examples?(moduledoc, docs), do: module

      for module <- shown,
          do: assert(module in run, "no test has `doctest #{inspect(module)}` without options")
    end
  end

  describe "a line" do
    test "of a document has at most 98 characters" do
      assert_none(too_long(@documents, :markdown))
    end

    test "of a source has at most 98 characters" do
      assert_none(
        @sources
        |> Enum.flat_map(&Path.wildcard(&1, match_dot: true))
        |> too_long(:elixir)
      )
    end
  end

  test "an error message names what failed or what was expected" do
    assert_none(
      for file <- Path.wildcard("lib/**/*.ex"),
          {line, message} <- file |> File.read!() |> Prose.vague_messages(),
          do: "#{file}:#{line}: #{message}"
    )
  end

  describe "the judge of form" do
    test "ignores tables, URLs and fences" do
      long = String.duplicate("word ", 30)
      text = "| #{long} |\n```\n#{long}\n```\nhttps://host/ #{long}\n#{long}\n"
      assert [{6, 150}] = Prose.long_lines(text, :markdown)
    end

    test "finds an example in a fence, in a doctest and in an indented block" do
      for text <- ["```sh\nbin/test\n```", "    iex> 1", "A bus.\n\n    open()\n"],
          do: assert(Prose.example?(text))

      for text <- ["A bus.", "A bus.\n\n  * `rate:` - in hertz\n    or as a unit\n"],
          do: refute(Prose.example?(text))
    end

    test "finds the end of the first sentence" do
      assert Prose.first_sentence?("Opens the bus.\n\nMore")
      refute Prose.first_sentence?("Opens the bus\n\nMore. And more.")
    end

    test "reads messages in any form" do
      source = """
      def f(x), do: raise(ArgumentError, "what is given is no number: " <> inspect(x))
      def g(x), do: raise BB.Error, message: "nobody has opened \#{x}"
      def h(x), do: if(x, do: {:error, "there is none"}, else: {:error, "that of \#{x} failed"})
      def message(error), do: if(error.path, do: "it is closed", else: "a \#{error.x} is what counts")
      def i(x), do: Mix.raise("who \#{x}")
      def j(x), do: raise("cannot open \#{x}")
      """

      assert source |> Prose.vague_messages() |> Enum.map(&elem(&1, 0)) == [1, 2, 3, 3, 4, 4, 5]
    end
  end

  describe "a document" do
    for document <- @documents do
      test "#{document} has no broken link" do
        for link <- links(unquote(document)), do: assert(File.exists?(link), "#{link} is missing")
      end

      test "#{document} names only existing commands" do
        for command <- commands(unquote(document)),
            do: assert(command in executables(), "#{command} is named and is no command")
      end
    end

    test "has no iex> example, because no test would run it" do
      assert Enum.filter(@documents, &(File.read!(&1) =~ "iex>")) == []
    end
  end

  test "the architecture names only files that exist" do
    text = File.read!("docs/architecture.md")

    files =
      for [_, file] <- Regex.scan(~r{`((?:lib|native|test|examples)/[^`<]+)`}, text), do: file

    assert length(files) > 30
    assert Enum.reject(files, &File.exists?/1) == []
  end

  test "the shipped robots have no parentheses around the words of the DSL" do
    {formatter, _binding} = Code.eval_file(".formatter.exs")

    words = for {word, _arity} <- formatter[:locals_without_parens], do: Regex.escape("#{word}")
    call = ~r/^\s*(#{Enum.join(words, "|")})\(/

    files =
      ~w(lib/ganglion/robot.ex lib/ganglion/robots/*.ex) ++
        ~w(lib/mix/tasks/ganglion.new/lib/robot.ex.eex)

    assert_none(
      for file <- Enum.flat_map(files, &Path.wildcard/1),
          {line, number} <- file |> File.stream!() |> Stream.with_index(1),
          line =~ call,
          do: "#{file}:#{number}: #{String.trim(line)}"
    )
  end

  test "the glossary has each term once" do
    rows = Regex.scan(~r/^\| \*\*(.+?)\*\*/m, File.read!("docs/glossary.md"))
    terms = for [_, terms] <- rows, term <- String.split(terms, ", "), do: term
    assert terms -- Enum.uniq(terms) == []
  end

  test "every command in bin/ is documented and has a usage line" do
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

  test "the changelog has a section for unreleased changes" do
    assert File.read!("CHANGELOG.md") =~ ~r/^## \[?Unreleased\]?$/m
  end

  describe "the blocks of" do
    for document <- @documents do
      test "#{document} are of a known kind, and correct as far as that shows without running" do
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

  # A folder for topics, apart from those of robots on this machine.
  defp environment do
    topics = Path.join("/dev/shm", Run.unique("blocks"))
    File.mkdir!(topics)
    on_exit(fn -> File.rm_rf!(topics) end)
    [{"CONDUIT_RING_DIR", topics}, {"MIX_ENV", "test"}, {"LC_ALL", "C.UTF-8"}]
  end

  defp assert_none([]), do: :ok
  defp assert_none(offenders), do: flunk(Enum.join(offenders, "\n"))

  defp too_long(files, kind) do
    for file <- files,
        {line, columns} <- file |> File.read!() |> Prose.long_lines(kind),
        do: "#{file}:#{line}: #{columns} characters"
  end

  # Modules of the application: `{module, moduledoc, docs, metadata}`. A moduledoc is a map of texts,
  # :none or :hidden.

  defp modules do
    for module <- Application.spec(:ganglion, :modules),
        Code.ensure_loaded?(module),
        ours?(module),
        not function_exported?(module, :__impl__, 1) do
      {:docs_v1, _, _, _, moduledoc, meta, docs} = Code.fetch_docs(module)
      {module, moduledoc, docs, meta}
    end
  end

  defp ours?(module) do
    source = to_string(module.module_info(:compile)[:source])
    Path.relative_to_cwd(source) in Source.own()
  end

  # The doc of one arity applies to the other arities of its name.
  defp undocumented(docs) do
    spoken_for = for {{kind, name, _}, _, _, doc, _} <- docs, doc != :none, do: {kind, name}

    for {{kind, name, arity}, _, _, :none, _} <- docs,
        kind in [:function, :macro, :callback, :macrocallback],
        {kind, name} not in spoken_for,
        do: {kind, name, arity}
  end

  # A function with defaults has one doc, and a spec for one of its arities is enough.
  # `use GenServer` and its like define child_spec/1, without a spec.
  defp unspecified(module, docs) do
    specified =
      case Code.Typespec.fetch_specs(module) do
        {:ok, specs} -> Enum.map(specs, &elem(&1, 0))
        :error -> []
      end

    for {{:function, name, arity}, _, _, doc, meta} <- docs,
        doc != :hidden,
        {name, arity} not in [{:child_spec, 1} | implemented(module)],
        not Enum.any?((arity - (meta[:defaults] || 0))..arity, &({name, &1} in specified)),
        do: {name, arity}
  end

  defp reason?(text), do: is_binary(text) and String.trim(text) != ""

  defp texts(docs) do
    for {{kind, name, arity}, _, _, %{} = doc, _} <- docs,
        kind not in [:type, :opaque],
        do: {"#{name}/#{arity}", doc}
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

  # Code has brackets of its own.
  defp prose(document) do
    document
    |> File.read!()
    |> String.replace(~r/^```.*?^```/ms, "")
    |> String.replace(~r/`[^`\n]*`/, "")
  end
end
