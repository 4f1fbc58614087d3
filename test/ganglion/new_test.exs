defmodule Ganglion.NewTest do
  @moduledoc """
  Tests the files that `mix ganglion.new` writes, and its errors. `test/new_test.exs` builds and
  runs projects.
  """

  use ExUnit.Case, async: true

  alias Ganglion.New
  alias Ganglion.New.{Dependency, Options}

  doctest Dependency
  doctest Ganglion.New.Name

  @moduletag :tmp_dir

  @here File.cwd!()

  describe "a project" do
    test "has the name of its folder", %{tmp_dir: dir} do
      assert {:ok, report} = new(dir, ["my_rover"])
      assert report =~ "MyRover is in my_rover"
      assert read(dir, "my_rover/lib/my_rover.ex") =~ ~r/^defmodule MyRover do$/m
      assert read(dir, "my_rover/mix.exs") =~ "@app :my_rover"
      assert File.exists?(Path.join(dir, "my_rover/test/my_rover_test.exs"))
      assert read(dir, "my_rover/config/target.exs") =~ ~s("my-rover")
    end

    test "may have another module name, and may be in an empty folder", %{tmp_dir: dir} do
      File.mkdir!(Path.join(dir, "rover"))
      assert {:ok, _} = new(dir, ["rover", "--module", "Lab.Rover7"])
      assert read(dir, "rover/lib/rover.ex") =~ ~r/^defmodule Lab.Rover7 do$/m
      assert read(dir, "rover/bin/demo") =~ "robot: Lab.Rover7"
    end

    test "is formatted Elixir, for any names and parts", %{tmp_dir: dir} do
      long = String.duplicate("VeryLong", 8)

      for {options, number} <-
            Enum.with_index([
              [],
              ["--native", "none"],
              ["--native", "python"],
              ["--module", long],
              ["--module", long, "--native", "python"],
              ["--target", "rpi4"]
            ]) do
        project = "robot#{number}"
        assert {:ok, _} = new(dir, [project | options])
        files = Path.wildcard(Path.join([dir, project, "**/*.{ex,exs}"]), match_dot: true)
        assert length(files) > 8

        for file <- files do
          text = File.read!(file)

          words =
            Keyword.fetch!(elem(Code.eval_file(".formatter.exs"), 0), :locals_without_parens)

          formatted = Code.format_string!(text, locals_without_parens: words)
          assert IO.iodata_to_binary([formatted, "\n"]) == text, file
        end

        for file <- Path.wildcard(Path.join([dir, project, "**/*"]), match_dot: true),
            File.regular?(file),
            do: refute(File.read!(file) =~ "<%", file)
      end
    end

    test "has executable commands and scripts with valid syntax", %{tmp_dir: dir} do
      assert {:ok, _} = new(dir, ["rover"])
      project = Path.join(dir, "rover")

      commands =
        for file <- Path.wildcard(Path.join(project, "{bin,firmware}/**/*")),
            File.regular?(file),
            Path.extname(file) == "",
            not String.ends_with?(file, "/environment"),
            do: file

      assert length(commands) == 7

      for file <- commands do
        assert Bitwise.band(File.stat!(file).mode, 0o111) == 0o111
        assert {_, 0} = System.cmd("bash", ["-n", file])
      end

      for name <- ~w(setup demo test) do
        assert {"usage: bin/" <> _, 0} = System.cmd(Path.join(project, "bin/#{name}"), ["--help"])
      end
    end

    test "finds the path of Ganglion, on any number of lines in mix.exs", %{tmp_dir: dir} do
      long = "git:https://example.org/" <> String.duplicate("a/", 40) <> "ganglion.git"

      for {from, option, found} <- [
            {@here, "path", @here},
            {"git:https://example.org/g.git", "git", "https://example.org/g.git"},
            {long, "git", String.replace_prefix(long, "git:", "")},
            {long <> "#v1", "ref", "v1"}
          ] do
        name = "rover#{System.unique_integer([:positive])}"
        assert {:ok, _} = new(dir, [name, "--from", from])
        asked = "source bin/environment; source_of #{option}"
        project = Path.join(dir, name)
        assert {said, 0} = System.cmd("bash", ["-c", asked], cd: project)
        said = String.trim(said)
        assert if(option == "path", do: Path.expand(said, project), else: said) == found
      end
    end

    test "copies the files that it shares with this repository", %{tmp_dir: dir} do
      assert {:ok, _} = new(dir, ["rover"])

      for file <- ~w(rel/vm.args.eex rootfs_overlay/etc/iex.exs firmware/provisioning.conf),
          do: assert(read(dir, "rover/" <> file) == File.read!(file))
    end

    test "calls Ganglion's scripts with its own keys", %{tmp_dir: dir} do
      assert {:ok, _} = new(dir, ["rover"])
      script = Path.join(dir, "rover/firmware/scripts/sign")
      assert {"usage: firmware/scripts/sign" <> _, 0} = System.cmd(script, ["--help"])
      File.write!(Path.join(dir, "app.fw"), "")
      assert {text, 1} = System.cmd(script, [Path.join(dir, "app.fw")], stderr_to_stdout: true)
      assert text =~ Path.join(dir, "rover/firmware/keys/firmware.priv") <> " is missing"
    end

    test "supports the given boards, or all", %{tmp_dir: dir} do
      assert {:ok, _} = new(dir, ["some", "--target", "rpi4,bbb", "--target", "rpi4"])
      mix = read(dir, "some/mix.exs")

      assert for([_, board] <- Regex.scan(~r/:nerves_system_(\w+),/, mix), do: board) ==
               ~w(rpi4 bbb)

      assert {:ok, _} = new(dir, ["all"])
      mix = read(dir, "all/mix.exs")
      for {board, _facts} <- Options.boards(), do: assert(mix =~ ":nerves_system_#{board}, ")
      assert read(dir, "all/README.md") =~ "`armv7-unknown-linux-gnueabihf`"
    end

    test "with Python is for the host only", %{tmp_dir: dir} do
      assert {:ok, _} = new(dir, ["rover", "--native", "python"])
      refute read(dir, "rover/mix.exs") =~ "nerves"

      for file <- ~w(firmware rel rootfs_overlay config/target.exs native/Cargo.toml) do
        refute File.exists?(Path.join([dir, "rover", file]))
      end
    end

    test "without a native process has none", %{tmp_dir: dir} do
      assert {:ok, _} = new(dir, ["rover", "--native", "none"])
      refute File.exists?(Path.join(dir, "rover/native"))
      refute read(dir, "rover/mix.exs") =~ "cargo"
      refute read(dir, "rover/lib/rover.ex") =~ "ranger"
    end

    # The file as Mix reads it, before the dependencies are fetched.
    test "imports its boards' configuration from Ganglion, once Ganglion is fetched", %{
      tmp_dir: dir
    } do
      assert {:ok, _} = new(dir, ["near", "--from", @here])
      assert {:ok, _} = new(dir, ["far", "--from", "git:https://host/ganglion.git"])

      near = target_config(Path.join(dir, "near"))
      assert near[:ganglion][:robot] == Near
      assert near[:ganglion][:board] == {BB.Firmware.Board.Nerves, []}
      assert near[:shoehorn][:handler] == BB.Firmware.Applications
      assert near[:mdns_lite][:hosts] == [:hostname, "near"]
      assert near[:mdns_lite][:ttl] == 120

      far = target_config(Path.join(dir, "far"))
      assert far[:ganglion] == [robot: Far]
    end

    # In a VM of its own, because Mix has one project at a time. Nerves' archive is not installed.
    defp target_config(project) do
      code = """
      Mix.start()
      Code.put_compiler_option(:no_warn_undefined, :all)
      Code.compile_file("mix.exs")
      config = Config.Reader.read!("config/target.exs", env: :prod, target: :rpi4)
      IO.write(Base.encode64(:erlang.term_to_binary(config)))
      """

      {text, 0} = System.cmd("elixir", ["-e", code], cd: project, env: [{"MIX_EXS", nil}])
      text |> Base.decode64!() |> :erlang.binary_to_term()
    end
  end

  describe "the dependency on Ganglion" do
    test "is by default the running checkout, by a relative path", %{tmp_dir: dir} do
      assert {:ok, _} = new(dir, ["deep/er/rover"])

      assert {:ok, {:path, path}} =
               Dependency.parse(nil, Path.join(dir, "deep/er/rover"), where(dir))

      assert Path.type(path) == :relative
      assert Path.expand(path, Path.join(dir, "deep/er/rover")) == @here
      assert read(dir, "deep/er/rover/mix.exs") =~ ~s({:ganglion, path: "#{path}"})
      assert read(dir, "deep/er/rover/native/Cargo.toml") =~ ~s("../#{path}/native/conduit_ring")
    end

    test "is a path that resolves behind a symbolic link", %{tmp_dir: dir} do
      File.mkdir_p!(Path.join(dir, "a/b"))
      File.ln_s!(Path.join(dir, "a/b"), Path.join(dir, "link"))

      assert {:ok, {:path, path}} =
               Dependency.parse(nil, Path.join(dir, "link/rover"), where(dir))

      assert Path.expand(path, Path.join(dir, "a/b/rover")) == @here
    end

    test "may be another checkout, or git with a branch, tag or commit", %{tmp_dir: dir} do
      path = Path.join(dir, "rover")
      assert {:ok, {:path, _}} = Dependency.parse(@here, path, where("/"))
      url = "https://host/ganglion.git"
      assert {:ok, {:git, ^url, nil} = git} = Dependency.parse("git:" <> url, path, where(dir))
      assert Dependency.entry(git) == ~s({:ganglion, git: "#{url}"})
      assert Dependency.folder(git) == "deps/ganglion"
      assert {:ok, {:git, ^url, "v1"} = git} = Dependency.parse("git:#{url}#v1", path, where(dir))
      assert Dependency.entry(git) == ~s({:ganglion, git: "#{url}", ref: "v1"})
    end

    test "on a git folder has its absolute path", %{tmp_dir: dir} do
      File.mkdir!(Path.join(dir, "clone"))

      assert {:ok, {:git, url, nil}} =
               Dependency.parse("git:clone", Path.join(dir, "r"), where(dir))

      assert url == Path.join(dir, "clone")
    end
  end

  test "invalid arguments return one sentence, and nothing is written", %{tmp_dir: dir} do
    File.mkdir!(Path.join(dir, "full"))
    File.write!(Path.join(dir, "full/file"), "")
    before = tree(dir)

    for {argv, words} <- [
          {[], ["expected the PATH", "got nothing"]},
          {~w(--native rust), ["expected the PATH", "got nothing"]},
          {~w(rover other), ["one PATH", "other"]},
          {~w(full), ["empty folder", Path.join(dir, "full")]},
          {~w(full/file), ["full/file", "exists already"]},
          {~w(full/file/rover), ["full/file", "exists already"]},
          {~w(Rover), ["a-z, 0-9 and _", ~s("Rover")]},
          {~w(my-rover), ["a-z, 0-9 and _", ~s("my-rover")]},
          {~w(7rover), [~s("7rover")]},
          {~w(ganglion), ["ganglion exists already"]},
          {~w(nerves), ["nerves exists already"]},
          {~w(kernel), ["kernel exists already"]},
          {~w(mix), ["mix exists already"]},
          {~w(rover --module rover), ["a module's name such as Rover", ~s("rover")]},
          {["rover", "--module", "Rover Two"], [~s("Rover Two")]},
          {["rover", "--module", "Rover\n"], [~S("Rover\n")]},
          {~w(rover --module Rover.), [~s("Rover.")]},
          {~w(rover --module BB), ["BB, which is taken"]},
          {~w(rover --module BB.Rover), ["BB.Rover, which is taken"]},
          {~w(rover --module Ganglion), ["Ganglion, which is taken"]},
          {~w(rover --module Kernel), ["Kernel, which is taken", "--module MyKernel"]},
          {~w(rover --module Enum), ["Enum, which is taken"]},
          {~w(rover --module Elixir.Rover), ["which is taken"]},
          {~w(enum), ["Enum, which is taken"]},
          {~w(rover --target rpi99), ["rpi4", "bbb", "qemu_aarch64", ~s(got: "rpi99")]},
          {["rover", "--target", "rpi4,,"], [~s(got: "")]},
          {~w(rover --target host), [~s(got: "host")]},
          {~w(rover --native cobol), ["none, rust or python", "cobol"]},
          {~w(rover --native python --target rpi4), ["carries Python", "rpi4", "--native rust"]},
          {~w(rover --bogus), ["--module NAME", "--bogus"]},
          {~w(rover --module), ["--module", "got nothing"]},
          {~w(rover --from full), ["checkout of Ganglion or git:URL", "full"]},
          {~w(rover --from git:), ["git:URL"]},
          {~w(rover --from git:https://host/g.git#), ["branch, tag or commit"]}
        ] do
      assert {:error, sentence} = new(dir, argv)
      for word <- words, do: assert(sentence =~ word, sentence)
      assert length(String.split(sentence, "\n")) == 1
      assert tree(dir) == before, "#{inspect(argv)} wrote something"
    end
  end

  test "bin/new and mix ganglion.new print an error on standard error and fail", %{
    tmp_dir: dir
  } do
    for {command, arguments, cd} <- [
          {Path.expand("bin/new"), ["rover", "--native", "cobol"], dir},
          {"mix", ["ganglion.new", Path.join(dir, "rover"), "--native", "cobol"], @here}
        ] do
      said = Path.join(dir, "said")
      shell = ~s(exec "$0" "$@" 2>"#{said}")
      # bin/test exports its caller's folder, which is not this test's.
      opts = [cd: cd, env: [{"GANGLION_CALLER_DIR", nil}]]
      {printed, status} = System.cmd("bash", ["-c", shell, command | arguments], opts)
      assert {printed, status} == {"", 1}
      # If Mix compiles first, its output precedes the error.
      lines = said |> File.read!() |> String.split("\n", trim: true)
      assert [line] = if(command == "mix", do: Enum.take(lines, -1), else: lines)
      assert line =~ "none, rust or python"
      refute File.exists?(Path.join(dir, "rover"))
    end
  end

  defp new(dir, argv), do: New.run(argv, where(dir))
  defp where(from), do: [from: from, checkout: @here]
  defp read(dir, file), do: File.read!(Path.join(dir, file))
  defp tree(dir), do: dir |> Path.join("**/*") |> Path.wildcard(match_dot: true) |> Enum.sort()
end
