defmodule Mix.Tasks.Compile.CargoTest do
  @moduledoc """
  Tests the Mix compiler for crates: the Rust target of a toolchain, the arguments of cargo, and
  the installed files, in this project and in a project that depends on it.
  """

  use ExUnit.Case, async: true

  alias Mix.Tasks.Compile.Cargo
  alias Mix.Tasks.Compile.Cargo.{Crates, Progress}

  doctest Cargo

  # The prefix of each board's C cross-compiler, and the Rust target.
  @boards [
    rpi3: {"armv7-nerves-linux-gnueabihf", "armv7-unknown-linux-gnueabihf"},
    rpi4: {"aarch64-nerves-linux-gnu", "aarch64-unknown-linux-gnu"},
    rpi5: {"aarch64-nerves-linux-gnu", "aarch64-unknown-linux-gnu"},
    bbb: {"armv7-nerves-linux-gnueabihf", "armv7-unknown-linux-gnueabihf"},
    x86_64: {"x86_64-nerves-linux-musl", "x86_64-unknown-linux-musl"},
    qemu_aarch64: {"aarch64-nerves-linux-gnu", "aarch64-unknown-linux-gnu"}
  ]

  describe "the triple" do
    for {board, {toolchain, triple}} <- @boards do
      test "of #{board} follows the basename of CROSSCOMPILE" do
        assert Cargo.triple("/somewhere/bin/" <> unquote(toolchain)) == unquote(triple)
      end
    end

    test "of Nerves' other toolchains is known too" do
      assert Cargo.triple("armv6-nerves-linux-gnueabihf") == "arm-unknown-linux-gnueabihf"
      assert Cargo.triple("riscv64-nerves-linux-gnu") == "riscv64gc-unknown-linux-gnu"
    end

    test "without CROSSCOMPILE is nil, for the host" do
      assert Cargo.triple(nil) == nil
    end

    test "of an unknown toolchain raises with the known ones" do
      error = assert_raise Mix.Error, fn -> Cargo.triple("/bin/mips-unknown-elf") end
      assert error.message =~ ~s("mips-unknown-elf")
      assert error.message =~ "aarch64-nerves-linux-gnu"
    end
  end

  describe "the environment for cargo" do
    @toolchain %{
      "CC" => "/t/bin/aarch64-nerves-linux-gnu-gcc",
      "CXX" => "/t/bin/aarch64-nerves-linux-gnu-g++",
      "AR" => "/t/bin/aarch64-nerves-linux-gnu-ar",
      "CFLAGS" => "-mcpu=cortex-a72",
      "CXXFLAGS" => "-mcpu=cortex-a72 -O2",
      "LDFLAGS" => "--sysroot=/t/sysroot",
      "HOME" => "/home/ada"
    }

    test "is unchanged for the host" do
      assert Cargo.env(nil, @toolchain) == []
    end

    test "links with the cross compiler" do
      env = Map.new(Cargo.env("aarch64-unknown-linux-gnu", @toolchain))
      assert env["CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER"] == @toolchain["CC"]
    end

    test "passes the board's compiler and flags by the triple's names only" do
      env = Cargo.env("aarch64-unknown-linux-gnu", @toolchain)

      for name <- ~w(CC CXX AR CFLAGS CXXFLAGS) do
        assert {name <> "_aarch64_unknown_linux_gnu", @toolchain[name]} in env
        assert {name, nil} in env
      end

      assert {"LDFLAGS", nil} in env
      assert Enum.all?(env, fn {_name, value} -> value != "/home/ada" end)
    end

    test "leaves out variables that the toolchain does not set" do
      env = Cargo.env("armv7-unknown-linux-gnueabihf", %{"CC" => "gcc"})
      given = for {name, value} when value != nil <- env, do: name

      assert Enum.sort(given) == [
               "CARGO_TARGET_ARMV7_UNKNOWN_LINUX_GNUEABIHF_LINKER",
               "CC_armv7_unknown_linux_gnueabihf"
             ]
    end

    test "links musl's C runtime dynamically, which a library needs" do
      env = Map.new(Cargo.env("x86_64-unknown-linux-musl", @toolchain))

      assert env["CARGO_TARGET_X86_64_UNKNOWN_LINUX_MUSL_RUSTFLAGS"] ==
               "-C target-feature=-crt-static"
    end
  end

  describe "the crates" do
    @ours [path: "native", nif: "our_nif", always: ["guard"], programs: ["camera", "tags"]]

    defp crates(cargo \\ @ours, asked), do: Crates.new(:rover, cargo, asked)

    test "are all crates of the project without a configuration" do
      assert {:ok, crates} = crates(nil)
      assert crates.packages == ~w(our_nif guard camera tags)

      assert Crates.files(crates) == [
               {"libour_nif.so", "our_nif.so"},
               {"guard", "bin/guard"},
               {"camera", "bin/camera"},
               {"tags", "bin/tags"}
             ]
    end

    test "are those of the configuration, by atom or string, and the ones of always:" do
      for asked <- [[:tags], ["tags"]] do
        assert {:ok, crates} = crates(asked)
        assert crates.packages == ~w(our_nif guard tags)
      end

      assert {:ok, %Crates{programs: ["guard"]}} = crates([])
    end

    test "may have several libraries" do
      assert {:ok, crates} = crates([nif: ["one", "an-other"]], nil)
      assert crates.packages == ~w(one an-other)

      assert Crates.files(crates) == [
               {"libone.so", "one.so"},
               {"liban_other.so", "an_other.so"}
             ]
    end

    test "may have a package with another name than its program, and a dash in a library's name" do
      assert {:ok, crates} = crates([nif: "rover-nif", programs: [{"tools", "detector"}]], nil)
      assert crates.packages == ~w(rover-nif tools)

      assert Crates.files(crates) == [
               {"librover_nif.so", "rover_nif.so"},
               {"detector", "bin/detector"}
             ]
    end

    test "unknown programs are an error that lists the known ones" do
      for {asked, got} <- [{[:kamera, :tags], "[:kamera]"}, {:camera, ":camera"}, {[1], "[1]"}] do
        assert {:error, sentence} = crates(asked)
        assert sentence =~ "config :rover, programs: expected a list of :camera, :tags, got: "
        assert sentence =~ got
      end
    end

    test "invalid options are an error" do
      for {cargo, words} <- [
            {nil, "add `cargo: [path:"},
            {:native, "expected keywords"},
            {[bins: []], "expected the keys :path"},
            {[path: 1], "path: a folder"},
            {[programs: "detector"], ~s(programs: a list of names)},
            {[programs: ["../x"]], ~s(programs: a list of names)},
            {[always: [1]], "always: a list"},
            {[nif: :rover], "nif: nil or the name"},
            {[nif: ["one", 2]], "or a list of names"},
            {[locked: nil], "locked: true or false"},
            {[path: "nowhere"], "no nowhere/Cargo.toml"}
          ] do
        assert {:error, sentence} = crates(cargo, nil)
        assert sentence =~ "rover"
        assert sentence =~ words
      end
    end
  end

  describe "the progress" do
    defp shown(texts) do
      {shown, _progress} =
        Enum.map_reduce(texts, %Progress{}, fn text, progress -> Progress.take(progress, text) end)

      Enum.join(shown)
    end

    test "is empty if cargo only prints that it has finished" do
      assert shown(["    Finished `release` profile [optimized] target(s) in 0.05s\n"]) == ""
      assert shown(["\e[1m\e[32m    Finished\e[0m `release` profile\n"]) == ""
      waiting = "    Blocking waiting for file lock on build directory\n"
      assert shown([waiting, "    Finished `release` profile\n"]) == waiting
    end

    test "is the whole output of cargo otherwise, line by line" do
      said = ["   Compiling came", "ra v0.1.0\nwarning: unused\n", "    Finished `release`\n"]
      assert shown(said) == Enum.join(said)
      {first, progress} = Progress.take(%Progress{}, Enum.at(said, 0))
      assert first == ""
      {second, _progress} = Progress.take(progress, Enum.at(said, 1))
      assert second == "   Compiling camera v0.1.0\nwarning: unused\n"
    end
  end

  describe "the compiler" do
    @describetag :tmp_dir
    @nif_crates ~w(conduit_ring_nif linux_bus_nif)
    @programs ~w(camera ganglion process_guard vision_tags)
    @built Enum.map(@nif_crates, &"lib#{&1}.so") ++ @programs

    # A stand-in for cargo: it records its arguments, and "builds".
    @cargo """
    #!/bin/sh
    { echo "$PWD: $*"; env; } > "$CARGO_LOG"
    [ -z "$CARGO_SAYS" ] || printf "$CARGO_SAYS" >&2
    while [ $# -gt 0 ]; do
      case "$1" in
        --target-dir) dir="$2" ;;
        --target) triple="$2" ;;
      esac
      shift
    done
    [ -z "$CARGO_IDLE" ] || exit 0
    mkdir -p "$dir/$triple/release"
    for file in #{Enum.join(@built, " ")}; do echo "$triple" > "$dir/$triple/release/$file"; done
    """

    setup %{tmp_dir: tmp_dir} do
      cargo = Path.join([tmp_dir, "bin", "cargo"])
      File.mkdir_p!(Path.dirname(cargo))
      File.write!(cargo, @cargo)
      File.chmod!(cargo, 0o755)
      %{log: Path.join(tmp_dir, "cargo.log"), build: Path.join(tmp_dir, "build")}
    end

    defp mix(task, context, env) do
      path = Path.join(context.tmp_dir, "bin") <> ":" <> System.get_env("PATH")

      System.cmd("mix", [task],
        env: [
          {"PATH", path},
          {"MIX_BUILD_PATH", context.build},
          {"CARGO_LOG", context.log} | env
        ],
        stderr_to_stdout: true
      )
    end

    test "builds for the toolchain's triple and installs library and programs in priv", context do
      env = [
        {"CROSSCOMPILE", "/t/bin/aarch64-nerves-linux-gnu"},
        {"CC", "/t/bin/aarch64-nerves-linux-gnu-gcc"},
        {"CFLAGS", "-mcpu=cortex-a72"}
      ]

      assert {_, 0} = mix("compile.cargo", context, env)
      priv = Path.join([context.build, "lib", "ganglion", "priv"])

      for file <-
            Enum.map(@nif_crates, &(&1 <> ".so")) ++ Enum.map(@programs, &Path.join("bin", &1)),
          do: assert(File.read!(Path.join(priv, file)) == "aarch64-unknown-linux-gnu\n")

      [called | environment] = context.log |> File.read!() |> String.split("\n", trim: true)
      assert called =~ ~r"/native: build --release --locked .*--target aarch64-unknown-linux-gnu "

      assert "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=/t/bin/aarch64-nerves-linux-gnu-gcc" in environment
      assert "CFLAGS_aarch64_unknown_linux_gnu=-mcpu=cortex-a72" in environment
      refute Enum.any?(environment, &String.starts_with?(&1, ["CC=", "CFLAGS="]))
    end

    # The files in priv, with their inodes.
    defp installed(context) do
      for file <- Path.wildcard(Path.join([context.build, "lib", "ganglion", "priv", "**"])),
          stat = File.stat!(file),
          stat.type == :regular,
          into: %{},
          do: {Path.basename(file), {stat.inode, stat.mtime}}
    end

    test "shows what cargo says, and copies and says nothing when cargo has nothing to do",
         context do
      said = "   Compiling camera v0.1.0\n    Finished `release` profile\n"
      assert {text, 0} = mix("compile.cargo", context, [{"CARGO_SAYS", said}])
      assert text =~ said
      first = installed(context)
      assert map_size(first) == 6

      # A rebuilt file has another inode.
      nothing = [{"CARGO_IDLE", "1"}, {"CARGO_SAYS", "    Finished `release` profile\n"}]
      assert {"", 0} = mix("compile.cargo", context, nothing)
      assert installed(context) == first
    end

    test "installs a program again that is missing or was rebuilt", context do
      assert {_, 0} = mix("compile.cargo", context, [])
      before = installed(context)
      File.rm!(Path.join([context.build, "lib", "ganglion", "priv", "bin", "camera"]))
      tags = Path.join([context.build, "native", "ganglion", "release", "vision_tags"])
      File.write!(tags <> ".new", "made anew")
      File.rename!(tags <> ".new", tags)
      assert {"", 0} = mix("compile.cargo", context, [{"CARGO_IDLE", "1"}])
      now = installed(context)
      assert Map.keys(now) == Map.keys(before)
      changed = for {name, mark} <- now, before[name] != mark, do: name
      assert Enum.sort(changed) == ["camera", "vision_tags"]
    end
  end

  describe "in a project that depends on it" do
    @describetag :tmp_dir

    # The project has the compiler as if from a dependency.
    defp project(dir, cargo, config \\ "") do
      File.mkdir_p!(Path.join(dir, "config"))
      File.write!(Path.join(dir, "config/config.exs"), "import Config\n" <> config)

      File.write!(Path.join(dir, "mix.exs"), """
      defmodule Rover.MixProject do
        use Mix.Project

        # Ganglion is on the code path, and no dependency: Mix prunes that from 1.15 on.
        def project do
          [
            app: :rover,
            version: "0.1.0",
            compilers: Mix.compilers() ++ [:cargo],
            prune_code_paths: false
          ] ++ #{cargo}
        end
      end
      """)
    end

    defp crate(dir) do
      File.mkdir_p!(Path.join(dir, "native/src"))

      File.write!(Path.join(dir, "native/Cargo.toml"), """
      [package]
      name = "detector"
      version = "0.1.0"
      edition = "2021"

      [[bin]]
      name = "detector"
      path = "src/main.rs"

      [[bin]]
      name = "tuner"
      path = "src/tuner.rs"
      """)

      File.write!(Path.join(dir, "native/src/main.rs"), ~S|fn main() { println!("seen"); }|)
      File.write!(Path.join(dir, "native/src/tuner.rs"), "fn main() {}")
    end

    defp compile(dir) do
      env = [
        {"ERL_LIBS", Path.join(Mix.Project.build_path(), "lib")},
        {"MIX_ENV", "dev"},
        {"MIX_BUILD_PATH", nil},
        {"CARGO_TARGET_DIR", nil}
      ]

      System.cmd("mix", ["compile"], cd: dir, env: env, stderr_to_stdout: true)
    end

    @both ~s([cargo: [programs: ["detector", {"detector", "tuner"}]]])

    test "its crates are built, run, and removed when they are deselected", %{tmp_dir: dir} do
      project(dir, @both)
      crate(dir)
      assert {text, 0} = compile(dir)
      assert text =~ "Compiling detector"
      bin = Path.join(dir, "_build/dev/lib/rover/priv/bin")
      assert Enum.sort(File.ls!(bin)) == ~w(detector tuner)
      assert {"seen\n", 0} = System.cmd(Path.join(bin, "detector"), [])
      assert File.dir?(Path.join(dir, "_build/cargo/rover/release"))

      assert {"", 0} = compile(dir)

      File.write!(Path.join(bin, "by_hand"), "")
      project(dir, @both, "config :rover, programs: [:tuner]\n")
      assert {_, 0} = compile(dir)
      assert Enum.sort(File.ls!(bin)) == ~w(by_hand tuner)
    end

    test "it fails if cargo fails, and shows its output", %{tmp_dir: dir} do
      project(dir, @both)
      crate(dir)
      File.write!(Path.join(dir, "native/src/main.rs"), "fn main() { no_such_function(); }")
      assert {text, 1} = compile(dir)
      assert text =~ "error[E0425]: cannot find function `no_such_function`"
    end

    test "errors are reported in a sentence", %{tmp_dir: dir} do
      project(dir, "[]")
      assert {text, 1} = compile(dir)
      assert text =~ "rover has the compiler :cargo and no options for it"

      project(dir, ~s([cargo: [programs: ["detector"]]]))
      assert {text, 1} = compile(dir)
      assert text =~ "rover has the compiler :cargo but no native/Cargo.toml"

      crate(dir)
      project(dir, ~s([cargo: [programs: [{"detector", "detektor"}]]]))
      assert {text, 1} = compile(dir)
      assert text =~ "cargo built no file detektor"

      project(
        dir,
        ~s([cargo: [programs: ["detector"]]]),
        "config :rover, programs: [:detektor]\n"
      )

      assert {text, 1} = compile(dir)
      assert text =~ "config :rover, programs: expected a list of :detector, got: [:detektor]"
    end
  end
end
