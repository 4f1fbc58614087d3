defmodule Mix.Tasks.Compile.CargoTest do
  @moduledoc "The Mix compiler of mix.exs: which Rust target a board's toolchain means, and what cargo is given."

  use ExUnit.Case, async: true

  alias Mix.Tasks.Compile.Cargo

  # The prefix of the C cross-compiler that each board's system brings, and Rust's name for the same.
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

    test "of the other toolchains of Nerves is known too" do
      assert Cargo.triple("armv6-nerves-linux-gnueabihf") == "arm-unknown-linux-gnueabihf"
      assert Cargo.triple("riscv64-nerves-linux-gnu") == "riscv64gc-unknown-linux-gnu"
    end

    test "without CROSSCOMPILE is none: the machine that builds" do
      assert Cargo.triple(nil) == nil
    end

    test "of an unknown toolchain is refused, with what is known" do
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

    test "is untouched for the machine that builds" do
      assert Cargo.env(nil, @toolchain) == []
    end

    test "links with the cross compiler" do
      env = Map.new(Cargo.env("aarch64-unknown-linux-gnu", @toolchain))
      assert env["CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER"] == @toolchain["CC"]
    end

    test "gives the board's compiler and flags by the triple's names, and to nobody else" do
      env = Cargo.env("aarch64-unknown-linux-gnu", @toolchain)

      for name <- ~w(CC CXX AR CFLAGS CXXFLAGS) do
        assert {name <> "_aarch64_unknown_linux_gnu", @toolchain[name]} in env
        assert {name, nil} in env
      end

      assert {"LDFLAGS", nil} in env
      assert Enum.all?(env, fn {_name, value} -> value != "/home/ada" end)
    end

    test "leaves out what the toolchain does not say" do
      env = Cargo.env("armv7-unknown-linux-gnueabihf", %{"CC" => "gcc"})
      given = for {name, value} when value != nil <- env, do: name

      assert Enum.sort(given) == [
               "CARGO_TARGET_ARMV7_UNKNOWN_LINUX_GNUEABIHF_LINKER",
               "CC_armv7_unknown_linux_gnueabihf"
             ]
    end

    test "links musl's C runtime dynamically, without which there is no library to load" do
      env = Map.new(Cargo.env("x86_64-unknown-linux-musl", @toolchain))

      assert env["CARGO_TARGET_X86_64_UNKNOWN_LINUX_MUSL_RUSTFLAGS"] ==
               "-C target-feature=-crt-static"
    end
  end

  describe "the compiler" do
    @describetag :tmp_dir
    @built ~w(libconduit_ring_nif.so camera ganglion process_guard vision_tags)

    # In the place of cargo: writes down how it was called, and "builds".
    @cargo """
    #!/bin/sh
    { echo "$PWD: $*"; env; } > "$CARGO_LOG"
    while [ $# -gt 0 ]; do
      case "$1" in
        --target-dir) dir="$2" ;;
        --target) triple="$2" ;;
      esac
      shift
    done
    [ -z "$CARGO_FAILS" ] || { echo "error: $CARGO_FAILS"; exit 101; }
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

    test "builds for the toolchain's triple and puts library and programs into priv", context do
      env = [
        {"CROSSCOMPILE", "/t/bin/aarch64-nerves-linux-gnu"},
        {"CC", "/t/bin/aarch64-nerves-linux-gnu-gcc"},
        {"CFLAGS", "-mcpu=cortex-a72"}
      ]

      assert {_, 0} = mix("compile.cargo", context, env)
      priv = Path.join([context.build, "lib", "ganglion", "priv"])

      for file <- ["conduit_ring_nif.so" | Enum.map(tl(@built), &Path.join("bin", &1))],
          do: assert(File.read!(Path.join(priv, file)) == "aarch64-unknown-linux-gnu\n")

      [called | environment] = context.log |> File.read!() |> String.split("\n", trim: true)
      assert called =~ ~r"/native: build --release --locked .*--target aarch64-unknown-linux-gnu "

      assert "CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=/t/bin/aarch64-nerves-linux-gnu-gcc" in environment
      assert "CFLAGS_aarch64_unknown_linux_gnu=-mcpu=cortex-a72" in environment
      refute Enum.any?(environment, &String.starts_with?(&1, ["CC=", "CFLAGS="]))
    end

    test "fails when cargo does, and shows what it said", context do
      assert {text, status} = mix("compile", context, [{"CARGO_FAILS", "no such crate"}])
      assert status == 1
      assert text =~ "error: no such crate"
    end
  end
end
