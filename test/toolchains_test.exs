defmodule ToolchainsTest do
  @moduledoc """
  Tests requirements of newer and older compilers that the installed one may not show.
  """

  use ExUnit.Case, async: true

  alias BB.Test.BitStrings
  alias Mix.Tasks.Compile.Cargo

  @sources Path.wildcard("{bench,config,examples,lib,rel,test}/**/*.{ex,exs}") ++ ["mix.exs"]

  describe "Elixir" do
    test "1.14 and 1.20 both take the sizes in all bit-string patterns" do
      found =
        for file <- @sources,
            {size, line} <- BitStrings.find(file),
            do: "#{file}:#{line}: #{size}"

      assert found == [],
             "bind the size in the same pattern, or use binary_part/3 or :erlang.split_binary/2"
    end

    test "a size from outside of its pattern is found, in any pattern" do
      for {text, size} <- [
            {"<<a::binary-size(n), _::binary>> = b", "n"},
            {"{:ok, <<a::size(n)>>} = b", "n"},
            {"<<a::size(n * 8)>> = b", "n * 8"},
            {"<<a::size(n)-unit(8)-little>> = b", "n"},
            {"<<a::n*8>> = b", "n"},
            {"<<m::8, a::size(m), b::size(n)>> = c", "n"},
            {"<<a::size(a)>> = b", "a"},
            {"case b do <<a::size(n)>> when a > 1 -> a end", "n"},
            {"fn <<a::size(n)>>, _ -> a end", "n"},
            {"receive do <<a::size(n)>> -> a end", "n"},
            {"with {:ok, <<a::size(n)>>} <- b, do: a", "n"},
            {"for <<a::size(n) <- b>>, do: a", "n"},
            {"for <<m::8, a::size(m + n) <- b>>, do: a", "m + n"},
            {"for <<a::size(n)>> <- b, do: a", "n"},
            {"def f(<<a::size(n)>>), do: a", "n"},
            {"defp f(<<a::size(n)>>) when a > 1, do: a", "n"},
            {"match?(<<_::size(n)>>, b)", "n"},
            {"assert_receive {:data, <<_::binary-size(n)>>}", "n"},
            {"<<a::size(^n)>> = b", "^n"},
            {"<<m::8, a::size(^m)>> = b", "^m"}
          ] do
        assert BitStrings.find(text, "a.ex") == [{"size(#{size})", 1}], text
      end
    end

    test "a size that the pattern binds, and one in a constructed bit string, are accepted" do
      for text <- [
            "<<n::8, a::binary-size(n), b::size(n * 8), _::binary>> = c",
            "<<n::8, a::n*8>> = c",
            "<<a::binary-size(4), b::size(@n), c::size(unquote(n))>> = d",
            "a = <<0::size(n)-unit(8)>>",
            "case n do n -> <<0::size(n)>> end",
            "for <<n::8, a::binary-size(n) <- b>>, do: <<a::size(n)>>",
            "f(<<a::size(n)>>)"
          ] do
        assert BitStrings.find(text, "a.ex") == [], text
      end
    end
  end

  describe "Elixir 1.20" do
    test "finds no attribute that it reserves" do
      found = for file <- @sources, line <- lines(file, ~r/^\s*@nifs\s/), do: line
      assert found == [], "name the attribute by another word: @nifs declares a module's NIFs"
    end

    test "finds no option of a project that it deprecates" do
      projects = ["mix.exs" | Path.wildcard("lib/mix/tasks/**/mix.exs*")]
      found = for file <- projects, line <- lines(file, ~r/^\s*xref:/), do: line
      assert found == [], "call the module by a variable: both 1.14 and 1.20 take that"
    end

    defp lines(file, regex) do
      for {text, line} <- file |> File.read!() |> String.split("\n") |> Enum.with_index(1),
          text =~ regex,
          do: "#{file}:#{line}: #{String.trim(text)}"
    end
  end

  # GCC's default is C23 from 15 on, and the AprilTag library is older C.
  describe "a C compiler whose default is C23" do
    @describetag :tmp_dir
    @config ".cargo/config.toml"
    @toolchains ~w(aarch64-nerves-linux-gnu armv6-nerves-linux-gnueabihf armv7-nerves-linux-gnueabihf
                   riscv64-nerves-linux-gnu x86_64-nerves-linux-musl)

    # A person or a distribution may set flags for this machine; only the standard is overridden.
    test "builds the AprilTag library, also with other flags", %{tmp_dir: tmp_dir} do
      names = ["HOST_CFLAGS", "CFLAGS_" <> String.replace(host(), "-", "_")]
      own = for name <- names, do: {name, "-DOWN_#{name} -std=gnu2x"}
      assert {_, 0} = build("native", tmp_dir, own)
      compiled = compiled(tmp_dir)
      assert compiled != []
      for line <- compiled, name <- ["CFLAGS" | names], do: assert(line =~ "-DOWN_#{name}")
    end

    test "builds the AprilTag library in every folder of the repository", context do
      assert {_, 0} = build("docs", context.tmp_dir, [])
    end

    test "fails without the flags of #{@config}", %{tmp_dir: tmp_dir} do
      assert {text, status} =
               build(System.tmp_dir!(), tmp_dir, [{"APRILTAG_SYS_METHOD", "raw,static"}])

      assert status != 0
      assert text =~ "compiled as C23"
    end

    test "gets the flag for every board's target, beside the flags of the board's system" do
      config = File.read!(@config)

      for toolchain <- @toolchains do
        triple = Cargo.triple(toolchain)
        assert config =~ ~s("CFLAGS_#{triple}" = "-std=gnu17")
        given = triple |> Cargo.env(%{"CFLAGS" => "-Os"}) |> Map.new()
        assert given["CFLAGS_" <> String.replace(triple, "-", "_")] == "-Os"
      end
    end
  end

  # Without optimisation, which takes long. The dependencies of the library's build are kept. The
  # library itself is rebuilt each time, because its flags contain the time.
  defp build(folder, tmp_dir, env) do
    System.cmd(
      "cargo",
      ~w(build --locked --package apriltag-sys --config profile.dev.package.apriltag-sys.opt-level=0) ++
        ["--manifest-path", Path.expand("native/Cargo.toml")] ++
        ["--target-dir", Path.expand("_build/c23")],
      cd: folder,
      env: [
        {"CC", Path.expand("test/support/c23/cc")},
        {"CFLAGS", "-DOWN_CFLAGS -DAT_#{System.os_time()} -std=gnu2x"},
        {"C23_LOG", log(tmp_dir)} | env
      ],
      stderr_to_stdout: true
    )
  end

  defp host do
    {text, 0} = System.cmd("rustc", ["-vV"])
    [_, host] = Regex.run(~r/^host: (.*)$/m, text)
    host
  end

  defp log(tmp_dir), do: Path.join(tmp_dir, "compiled.log")

  defp compiled(tmp_dir) do
    for line <- tmp_dir |> log() |> File.read!() |> String.split("\n"),
        line =~ "apriltag-src",
        do: line
  end
end
