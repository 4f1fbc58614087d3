defmodule Mix.Tasks.Compile.Cargo do
  @shortdoc "Builds the Rust workspace native/ into _build"
  @moduledoc """
  Runs cargo on the workspace `native/` and puts what it built into the application's `priv`.

  The build goes below Mix's build folder, so that the source tree stays clean: to `cargo/` there for the machine that builds,
  where all environments and cargo's own tests share it, and to `native/` in the target's build path for a board. The NIF becomes `priv/conduit_ring_nif.so`, the programs go to `priv/bin/`.

  A target build follows Nerves' toolchain: the basename of `CROSSCOMPILE` names the Rust triple (`triple/1`), `CC` is the
  linker and the compiler of C sources inside crates (`env/2`).
  """
  use Mix.Task.Compiler

  @nif "conduit_ring_nif"
  @programs ~w(camera ganglion process_guard vision_tags)

  @triples %{
    "aarch64-nerves-linux-gnu" => "aarch64-unknown-linux-gnu",
    "armv6-nerves-linux-gnueabihf" => "arm-unknown-linux-gnueabihf",
    "armv7-nerves-linux-gnueabihf" => "armv7-unknown-linux-gnueabihf",
    "riscv64-nerves-linux-gnu" => "riscv64gc-unknown-linux-gnu",
    "x86_64-nerves-linux-musl" => "x86_64-unknown-linux-musl"
  }

  @impl Mix.Task.Compiler
  def run(_argv) do
    triple = triple(System.get_env("CROSSCOMPILE"))
    target_dir = target_dir(triple)

    case System.cmd("cargo", arguments(triple, target_dir), options(triple)) do
      {_, 0} -> install(Path.join([target_dir, triple || "", "release"]))
      {_, status} -> {:error, [diagnostic(status)]}
    end
  rescue
    error in ErlangError ->
      reraise_unless_missing(error, __STACKTRACE__)
  end

  @impl Mix.Task.Compiler
  def clean do
    "CROSSCOMPILE" |> System.get_env() |> triple() |> target_dir() |> File.rm_rf!()
    :ok
  end

  @doc "The Rust target triple of a Nerves toolchain prefix (`CROSSCOMPILE`); `nil` is the machine that builds."
  def triple(nil), do: nil

  def triple(crosscompile) do
    name = Path.basename(crosscompile)

    Map.get(@triples, name) ||
      Mix.raise(
        "no Rust target is known for the toolchain #{inspect(name)} (CROSSCOMPILE); known: #{Enum.join(Map.keys(@triples), ", ")}"
      )
  end

  @doc """
  What cargo's environment needs for `triple`, given the environment of Mix: `{name, value}` sets, `{name, nil}` removes.

  The flags of the cross compiler are given by the triple's own names. Under their plain names they would reach the
  build scripts too, which run on the machine that builds.
  """
  def env(nil, _mix_env), do: []

  def env(triple, mix_env) do
    lower = String.replace(triple, "-", "_")
    upper = String.upcase(lower)

    for_triple =
      for name <- ~w(CC CXX AR CFLAGS CXXFLAGS),
          value = mix_env[name],
          do: {"#{name}_#{lower}", value}

    plain = for name <- ~w(CC CXX AR CFLAGS CXXFLAGS LDFLAGS), do: {name, nil}
    linker = for cc <- List.wrap(mix_env["CC"]), do: {"CARGO_TARGET_#{upper}_LINKER", cc}
    plain ++ for_triple ++ linker ++ rustflags(triple, upper)
  end

  # A cdylib cannot be linked with musl's static C runtime.
  defp rustflags("x86_64-unknown-linux-musl", upper),
    do: [{"CARGO_TARGET_#{upper}_RUSTFLAGS", "-C target-feature=-crt-static"}]

  defp rustflags(_triple, _upper), do: []

  defp arguments(triple, target_dir) do
    packages = Enum.flat_map([@nif | @programs], &["--package", &1])
    target = if triple, do: ["--target", triple], else: []

    ["build", "--release", "--locked", "--quiet", "--target-dir", target_dir] ++
      target ++ packages
  end

  # Boards of one triple differ in their flags.
  defp target_dir(triple) do
    build_path = Mix.Project.build_path()

    if triple || System.get_env("MIX_BUILD_PATH"),
      do: Path.join(build_path, "native"),
      else: Path.join(Path.dirname(build_path), "cargo")
  end

  defp options(triple) do
    [
      cd: "native",
      env: env(triple, System.get_env()),
      into: IO.stream(:stdio, :line),
      stderr_to_stdout: true
    ]
  end

  defp install(built) do
    priv = Path.join(Mix.Project.app_path(), "priv")
    File.mkdir_p!(Path.join(priv, "bin"))

    files = [{"lib#{@nif}.so", "#{@nif}.so"}] ++ Enum.map(@programs, &{&1, Path.join("bin", &1)})

    changed =
      Enum.filter(files, fn {from, to} -> copy(Path.join(built, from), Path.join(priv, to)) end)

    {if(changed == [], do: :noop, else: :ok), []}
  end

  # A running program or a loaded NIF keeps its old file: the new one takes its name.
  defp copy(from, to) do
    unless same?(from, to) do
      File.cp!(from, to <> ".new")
      File.rename!(to <> ".new", to)
      true
    end
  end

  defp same?(from, to) do
    case {File.stat!(from), File.stat(to)} do
      {%{size: size, mtime: built}, {:ok, %{size: size, mtime: copied}}} -> copied >= built
      _ -> false
    end
  end

  defp diagnostic(status) do
    %Mix.Task.Compiler.Diagnostic{
      compiler_name: "cargo",
      file: Path.expand("native/Cargo.toml"),
      message: "cargo ended with status #{status}; what it said stands above",
      position: 0,
      severity: :error
    }
  end

  defp reraise_unless_missing(%ErlangError{original: :enoent}, _stacktrace),
    do: Mix.raise("cargo was not found in PATH; bin/setup installs Rust")

  defp reraise_unless_missing(error, stacktrace), do: reraise(error, stacktrace)
end

defmodule Ganglion.MixProject do
  use Mix.Project

  @app :ganglion
  @version "0.1.0"
  @targets [:rpi3, :rpi4, :rpi5, :bbb, :x86_64, :qemu_aarch64]

  def project do
    [
      app: @app,
      version: @version,
      elixir: "~> 1.14",
      compilers: [:cargo] ++ Mix.compilers(),
      elixirc_paths: elixirc_paths(Mix.env()),
      start_permanent: Mix.env() == :prod,
      deps: deps(Mix.target())
    ] ++ for_target(Mix.target())
  end

  def application do
    [
      mod: {Ganglion.Application, []},
      extra_applications: [:logger, :runtime_tools, :sasl, :ssh] ++ test_applications(Mix.env())
    ]
  end

  defp test_applications(:test), do: [:proper]
  defp test_applications(_env), do: []

  if Version.match?(System.version(), ">= 1.15.0") do
    def cli, do: [preferred_targets: [run: :host, test: :host]]
  end

  defp elixirc_paths(:test), do: ["lib", "test/support"]
  defp elixirc_paths(_env), do: ["lib"]

  defp for_target(:host), do: [releases: [{@app, host_release()}]]

  defp for_target(_target),
    do: [archives: [nerves_bootstrap: "~> 1.16"], releases: [{@app, release()}]]

  # The templates in rel/ are for boards, whose VM is watched by a heart. The host's release has Mix's own.
  defp host_release, do: [overwrite: true, rel_templates_path: "rel/host"]

  defp release do
    [
      overwrite: true,
      cookie: "#{@app}_cookie",
      include_erts: &Nerves.Release.erts/0,
      steps: [&Nerves.Release.init/1, :assemble],
      strip_beams: Mix.env() == :prod or [keep: ["Docs"]]
    ]
  end

  # Mix looks up the source of every dependency before it filters by `targets:`, so only an empty list works without Hex.
  defp deps(:host), do: []

  defp deps(_target) do
    [
      {:nerves, "~> 1.15", runtime: false},
      {:shoehorn, "~> 0.9.3"},
      {:ring_logger, "~> 0.11.6"},
      {:toolshed, "~> 0.5"},
      {:rustler, "~> 0.38", runtime: false},
      {:nerves_runtime, "~> 0.13.13"},
      {:nerves_pack, "~> 0.7.2"},
      {:vintage_net, "~> 0.13.13"},
      {:circuits_i2c, "~> 2.1"},
      {:circuits_gpio, "~> 2.3"},
      {:nerves_system_rpi3, "~> 2.0", runtime: false, targets: :rpi3},
      {:nerves_system_rpi4, "~> 2.1", runtime: false, targets: :rpi4},
      {:nerves_system_rpi5, "~> 2.1", runtime: false, targets: :rpi5},
      {:nerves_system_bbb, "~> 2.20", runtime: false, targets: :bbb},
      {:nerves_system_x86_64, "~> 1.34", runtime: false, targets: :x86_64},
      {:nerves_system_qemu_aarch64, "~> 0.4", runtime: false, targets: :qemu_aarch64}
    ]
    |> Enum.map(&for_known_targets/1)
  end

  defp for_known_targets({name, requirement}), do: {name, requirement, targets: @targets}

  defp for_known_targets({name, requirement, opts}),
    do: {name, requirement, Keyword.put_new(opts, :targets, @targets)}
end
