defmodule DocumentationTest do
  @moduledoc "Holds what the documentation promises: it is there, its links lead somewhere, and its examples run."

  # The README's robot uses the bus "i2c-1", as a reader would, and that name is one for the whole VM.
  use ExUnit.Case, async: false

  alias BB.Test.Source

  @documents ~w(README.md CONTRIBUTING.md CHANGELOG.md firmware/README.md docs/**/*.md native/**/README.md)
             |> Enum.flat_map(&Path.wildcard/1)

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

  test "the changelog has a section for what is not yet released" do
    assert File.read!("CHANGELOG.md") =~ ~r/^## \[?Unreleased\]?$/m
  end

  test "the README's robot can be declared and started, and is heard as the README says" do
    assert [example] = Enum.filter(examples("README.md"), &(&1 =~ "defmodule"))

    ast =
      example |> Code.string_to_quoted!(file: "README.md") |> Macro.prewalk(&rename(&1, Readme))

    start_supervised!({BB.Bus.Sim, buses: %{"i2c-1" => [devices: %{0x68 => mpu6050()}]}})

    assert {%BB.Math.Vec3{}, _binding} = Code.eval_quoted(ast)
    Supervisor.stop(Module.concat([__MODULE__, Readme, MyRobot]))
  end

  test "the examples of the guide to parameters run one after the other" do
    Process.flag(:trap_exit, true)
    binding = run("docs/guides/parameters.md")
    assert Path.wildcard(Path.join(System.tmp_dir!(), "my_robot_params*")) == []
    Supervisor.stop(binding[:buses])
  end

  test "the examples of the guide to safety run one after the other" do
    Process.flag(:trap_exit, true)
    assert [_ | _] = run("docs/guides/safety.md")
  end

  test "the examples of the guide to health run one after the other" do
    Process.flag(:trap_exit, true)
    binding = run("docs/guides/health.md")
    Supervisor.stop(binding[:root])
    Supervisor.stop(binding[:buses])
  end

  test "the examples of the guide to the sensors that ship run one after the other" do
    Process.flag(:trap_exit, true)
    binding = run("docs/guides/sensors.md")
    Supervisor.stop(binding[:root])
    Supervisor.stop(binding[:buses])
  end

  test "the examples of the guide to drivers run one after the other" do
    binding = run("docs/guides/drivers.md")
    Supervisor.stop(binding[:root])
    Supervisor.stop(binding[:buses])
  end

  test "the examples of the guide from Beam Bots run one after the other" do
    binding = run("docs/guides/from-beam-bots.md")
    Supervisor.stop(binding[:root])
  end

  defp guide(document), do: Module.concat([Macro.camelize(Path.basename(document, ".md"))])

  # Each may name what those before it have bound.
  defp run(document) do
    Enum.reduce(examples(document), [], fn example, binding ->
      ast =
        example
        |> Code.string_to_quoted!(file: document)
        |> Macro.prewalk(&rename(&1, guide(document)))

      {_result, binding} = Code.eval_quoted(ast, binding)
      binding
    end)
  end

  defp mpu6050, do: {BB.Bus.Sim.Mpu6050, source: :motion}

  # Robots of different documents have the same name there.
  defp rename({:__aliases__, meta, [:MyRobot | rest]}, document),
    do: {:__aliases__, meta, [__MODULE__, document, :MyRobot | rest]}

  defp rename(node, _document), do: node

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

  defp examples(document) do
    for [_, code] <- Regex.scan(~r/^```elixir\n(.*?)^```/ms, File.read!(document)), do: code
  end
end
