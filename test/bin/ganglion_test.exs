defmodule Bin.GanglionTest do
  @moduledoc "Tests the program `ganglion` in a checkout and on a board's console."

  use ExUnit.Case, async: true

  alias BB.Test.Run

  @on_a_board Path.expand("rootfs_overlay/usr/bin/ganglion")

  test "bin/ganglion is the program of this checkout" do
    version = Mix.Project.config()[:version]
    assert run("bin/ganglion", ["--version"]) == {"ganglion #{version}\n", 0}
    assert {"ganglion hz: " <> _, 0} = run("bin/ganglion", ["help", "hz"])
    assert {said, 2} = run("bin/ganglion", ["topcis"])
    assert said =~ "did you mean topics?"
  end

  test "a board's console finds the release's program, whatever its version" do
    release = Path.join(System.tmp_dir!(), Run.unique("release"))
    on_exit(fn -> File.rm_rf!(release) end)
    program = Path.join(release, "lib/ganglion-7.8.9/priv/bin/ganglion")
    File.mkdir_p!(Path.dirname(program))
    File.write!(program, "#!/bin/sh\necho \"$# $*\"\n")
    File.chmod!(program, 0o755)

    assert run(@on_a_board, ["echo", "a topic"], [{"RELEASE_ROOT", release}]) ==
             {"2 echo a topic\n", 0}
  end

  test "a board without the program reports it" do
    assert {said, 1} = run(@on_a_board, ["topics"], [{"RELEASE_ROOT", "/nowhere"}])
    assert said =~ "cannot find a program at /nowhere/lib/ganglion-*/priv/bin/ganglion"
  end

  defp run(command, arguments, env \\ []),
    do: System.cmd(Path.expand(command), arguments, env: env, stderr_to_stdout: true)
end
