defmodule FirstStepsTest do
  @moduledoc """
  Runs the shell blocks of README and guides one after the other in a fresh clone, as a reader
  would. `bin/test docs` runs this test; `mix test` skips it, because it builds everything again.
  """

  use ExUnit.Case, async: false

  alias BB.Test.{DocBlocks, Run}

  @moduletag :docs
  @moduletag timeout: 3_600_000

  @documents ~w(README.md CONTRIBUTING.md firmware/README.md docs/**/*.md native/**/README.md)
             |> Enum.flat_map(&Path.wildcard/1)
             |> Enum.filter(&(&1 |> DocBlocks.read!() |> DocBlocks.select("sh") != []))

  # In a folder of its own, for projects that the blocks make beside the clone.
  setup_all do
    folder = Path.join(System.tmp_dir!(), Run.unique("clone"))
    clone = Path.join(folder, "ganglion")
    clone(clone)
    on_exit(fn -> File.rm_rf!(folder) end)
    %{clone: clone}
  end

  setup %{clone: clone} do
    unique = Run.unique("steps")
    home = Path.join(System.tmp_dir!(), unique)
    topics = Path.join("/dev/shm", unique)
    robot = Path.join(Path.dirname(clone), "rover")
    for folder <- [home, topics], do: File.mkdir!(folder)
    on_exit(fn -> for folder <- [home, topics, robot], do: File.rm_rf!(folder) end)
    %{clone: clone, env: environment(home, topics)}
  end

  for document <- @documents do
    test "the shell blocks of #{document} run in a fresh clone", %{clone: clone, env: env} do
      all = DocBlocks.read!(unquote(document))
      DocBlocks.save(all, clone)
      blocks = DocBlocks.select(all, "sh")
      {output, status} = DocBlocks.run_sh(blocks, clone, env: env, seconds: 3_000)
      assert status == 0, output
      assert DocBlocks.missing(all, Path.join(Path.dirname(clone), "rover")) == []
    end
  end

  # The files of this checkout that git has, or would have after `git add`. Cargo's builds of
  # foreign crates are copied, which saves minutes and changes nothing.
  defp clone(folder) do
    File.mkdir_p!(folder)
    listed = "git ls-files -z --cached --others --exclude-standard | xargs -0 ls -d 2>/dev/null"
    assert {"", 0} = sh("#{listed} | tar -cf - -T - | tar -xf - -C '#{folder}'")

    if File.dir?("_build/cargo/release") do
      File.mkdir_p!("#{folder}/_build/cargo")
      assert {"", 0} = sh("cp -a _build/cargo/release '#{folder}/_build/cargo/'")
    end
  end

  defp sh(command), do: System.cmd("sh", ["-c", command], stderr_to_stdout: true)

  # A reader has no variables of Mix or of this run; Rust is where it is installed.
  defp environment(home, topics) do
    real = System.user_home!()

    [
      {"HOME", home},
      {"CARGO_HOME", System.get_env("CARGO_HOME") || Path.join(real, ".cargo")},
      {"RUSTUP_HOME", System.get_env("RUSTUP_HOME") || Path.join(real, ".rustup")},
      {"PATH", System.fetch_env!("PATH") <> ":" <> Path.join(real, ".cargo/bin")},
      {"CONDUIT_RING_DIR", topics},
      {"MIX_ENV", nil},
      # The folder from which bin/test was called is not the reader's.
      {"GANGLION_CALLER_DIR", nil},
      {"MIX_BUILD_PATH", nil},
      {"LC_ALL", "C.UTF-8"}
    ]
  end
end
