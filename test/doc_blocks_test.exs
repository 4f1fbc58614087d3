defmodule DocBlocksTest do
  @moduledoc "Tests that a block which does not work as documented is found."

  use ExUnit.Case, async: true

  alias BB.Test.DocBlocks

  @environment [{"MIX_ENV", "test"}, {"LC_ALL", "C.UTF-8"}]

  test "blocks are read with their language, words, line and code" do
    text = """
    # A page

    ```sh board
    ls
    ```
    1. In a list:

       ````elixir
       a = 1
         b = ```2
       ````

    ```
    $ ls
    ```
    """

    assert [sh, elixir, text] = DocBlocks.parse(text, "page.md")
    assert %{language: "sh", words: ["board"], line: 4, code: "ls\n"} = sh
    assert %{language: "elixir", words: [], line: 9, code: "a = 1\n  b = ```2\n"} = elixir
    assert %{language: "text", code: "$ ls\n"} = text
    assert DocBlocks.place(elixir) == "page.md:9"
  end

  test "a fence that is never closed is an error" do
    assert_raise RuntimeError, ~r/page.md:1: the fence ``` is never closed/, fn ->
      DocBlocks.parse("```sh\nls\n", "page.md")
    end
  end

  test "blocks that cannot be run are checked" do
    assert check("sh", "firmware/scripts/sign image.fw && bin/test elixir  # all\n", ["board"]) ==
             []

    assert check("sh", "GANGLION_NAME=ada firmware/scripts/burn image.fw\n", ["board"]) == []
    assert check("sh", "bin/demo \\\n  --seconds 3\n", ["long"]) == []
    assert check("elixir", "config :ganglion, robot: MyRobot\n", ["config"]) == []

    for {language, code, words, complaint} <- [
          {"sh", "bin/dmeo\n", ["long"], "bin/dmeo is no command"},
          {"sh", "bin/demo --secs=3\n", ["long"], "bin/demo has no --secs"},
          {"sh", "bin/test elixirs\n", ["long"], "bin/test has no elixirs"},
          {"sh", "ganglion hz imu --fix\n", ["board"], "bin/ganglion has no --fix"},
          {"sh", "if true; then\n", ["board"], "syntax error"},
          {"sh", "ls\n", ["bord"], "sh bord means nothing"},
          {"elixer", "1\n", [], "no such language as elixer"},
          {"elixir", "config :ganglion, BB.Firmware.Gard, a: 1\n", ["config"], "there is no BB."},
          {"elixir", "config :ganglion\n", ["config"], "config/1"},
          {"elixir", "cmd \"\n", ["board"], "missing terminator"}
        ] do
      assert [said | _] = check(language, code, words)
      assert "page.md:1: " <> _ = said
      assert said =~ complaint
    end
  end

  test "Elixir blocks run one after the other, with the bindings of earlier ones" do
    page = """
    ```elixir
    defmodule Early, do: defstruct [:a]
    import Bitwise
    a = 1
    ```
    ```elixir
    %Early{a: ^a} = %Early{a: 5 &&& 3}
    IO.puts("a is " <> to_string(a))
    ```
    """

    assert {said, 0} = run_elixir(page)
    assert said =~ "a is 1"
  end

  test "an Elixir block that fails is reported with its place in the document" do
    assert {said, 1} = run_elixir("\n```elixir\n1 = 1\n1 = 2\n```\n")
    assert said =~ "MatchError"
    assert said =~ "page.md:4"
  end

  test "a process that dies ends its page, as it ends an IEx shell" do
    assert {said, status} =
             run_elixir(
               "```elixir\nspawn_link(fn -> exit(:gone) end)\nProcess.sleep(:infinity)\n```\n"
             )

    assert status != 0
    assert said =~ "gone"
  end

  test "shell blocks share a shell, and the first command that fails ends it" do
    page = "```sh\nexport A=b\ncd /\n```\n```sh\necho \"$PWD $A\"\nfalse\necho never\n```\n"
    blocks = DocBlocks.parse(page, "page.md")
    assert {said, 1} = DocBlocks.run_sh(blocks, File.cwd!())
    assert said =~ "\n/ b\n"
    refute said =~ "\nnever"
  end

  test "a quotation of a project's file has to be in that file, in order" do
    folder = Path.join(System.tmp_dir!(), BB.Test.Run.unique("project"))
    on_exit(fn -> File.rm_rf!(folder) end)
    File.mkdir_p!(folder)
    File.write!(Path.join(folder, "a.ex"), "a do\n  b\n\n  c\n  d\nend\n")

    assert missing("a do\n  b\n  d\nend\n", folder) == []
    assert missing("a do\n  d\n  b\nend\n", folder) == ["page.md:1: b", "page.md:1: end"]
    assert missing("x\n", folder) == ["page.md:1: x"]
  end

  defp missing(code, folder) do
    block = %DocBlocks{document: "page.md", line: 1, language: "elixir", code: code}
    DocBlocks.missing([%{block | words: ["a.ex"]}], folder)
  end

  defp check(language, code, words) do
    block = %DocBlocks{document: "page.md", line: 1, language: language, code: code, words: words}
    DocBlocks.check(block, File.cwd!())
  end

  defp run_elixir(page) do
    blocks = DocBlocks.parse(page, "page.md")
    DocBlocks.run_elixir(blocks, File.cwd!(), env: @environment, mix: ["--no-start"])
  end
end
