defmodule Mix.Tasks.Compile.Cargo do
  @shortdoc "Builds a project's Rust crates and puts them into its priv"
  @moduledoc """
  A Mix compiler that builds the Rust crates of a project with cargo.

  Use it in a project that depends on Ganglion and has native programs or NIFs of its own. It
  installs NIFs in the application's `priv` and programs in `priv/bin`. Ganglion builds its own
  crates with it.

      def project do
        [
          app: :rover,
          compilers: Mix.compilers() ++ [:cargo],
          cargo: [path: "native", programs: ["detector"]],
          ...
        ]
      end

  `BB.Sensor.NativeProcess` then finds the program by `program: {:rover, "detector"}`.

  ## Options

  The keyword list `cargo:` of `project/0`:

    * `path:` - the folder with the `Cargo.toml` of the crate or workspace, relative to the
      project; `"native"` by default
    * `programs:` - the programs to build, by the names of their packages; `{"tools", "detector"}`
      is the program `detector` of the package `tools`
    * `always:` - programs that are built whatever the configuration selects
    * `nif:` - the package of a NIF, or a list of packages, `nil` by default; its library becomes
      `priv/<name>.so`
    * `locked:` - whether an outdated `Cargo.lock` is an error, `false` by default

  The configuration of the application selects at compile time which of `programs:` are built. By
  default all are:

      config :rover, programs: [:detector]
      config :ganglion, programs: []

  A program that is no longer selected is removed from `priv`.

  ## What it does

  cargo decides what to build, and its progress is on standard error. If cargo has nothing to
  build, the compiler prints and copies nothing and returns `:noop`. Builds are optimised
  (`--release`) in every Mix environment.

  Builds are below Mix's build folder, so that the source tree stays clean: in `cargo/` there for
  the host, shared by all environments, and in the target's build path for a board.
  `CARGO_TARGET_DIR` overrides the folder.

  A build for a board uses Nerves' toolchain: the basename of `CROSSCOMPILE` determines the Rust
  target triple (`triple/1`), and `CC` is the linker and the compiler of C sources inside crates
  (`env/2`).
  """
  use Mix.Task.Compiler

  alias Mix.Tasks.Compile.Cargo.{Crates, Priv, Progress}

  @triples %{
    "aarch64-nerves-linux-gnu" => "aarch64-unknown-linux-gnu",
    "armv6-nerves-linux-gnueabihf" => "arm-unknown-linux-gnueabihf",
    "armv7-nerves-linux-gnueabihf" => "armv7-unknown-linux-gnueabihf",
    "riscv64-nerves-linux-gnu" => "riscv64gc-unknown-linux-gnu",
    "x86_64-nerves-linux-musl" => "x86_64-unknown-linux-musl"
  }

  @impl Mix.Task.Compiler
  def run(_argv) do
    crates = crates()
    triple = toolchain()
    target_dir = target_dir(crates, triple)
    built = Path.join([target_dir, triple || "", "release"])

    case build(crates, triple, target_dir) do
      0 -> crates |> Crates.files() |> Priv.install(built)
      status -> {:error, [diagnostic(crates, status)]}
    end
  end

  @impl Mix.Task.Compiler
  def clean do
    crates = crates()
    Priv.remove()
    # CARGO_TARGET_DIR may hold the builds of other projects.
    if given_target_dir() == nil, do: remove(target_dir(crates, toolchain())), else: :ok
  end

  @doc """
  Returns the Rust target triple of a Nerves toolchain prefix (`CROSSCOMPILE`).

  `nil` stands for the host. An unknown toolchain raises `Mix.Error`.

      iex> Mix.Tasks.Compile.Cargo.triple("/toolchains/bin/aarch64-nerves-linux-gnu")
      "aarch64-unknown-linux-gnu"
  """
  @spec triple(String.t() | nil) :: String.t() | nil
  def triple(nil), do: nil

  def triple(crosscompile) do
    name = Path.basename(crosscompile)

    Map.get(@triples, name) ||
      Mix.raise(
        "unknown toolchain #{inspect(name)} in CROSSCOMPILE; expected one of " <>
          Enum.join(Map.keys(@triples), ", ")
      )
  end

  @doc """
  Returns the changes to cargo's environment for `triple`, from the environment of Mix.

  `{name, value}` sets a variable and `{name, nil}` removes it. The flags of the cross compiler
  get names with the triple. Under their plain names they would also apply to build scripts, which
  run on the host.
  """
  @spec env(String.t() | nil, %{String.t() => String.t()}) :: [{String.t(), String.t() | nil}]
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

  defp toolchain, do: triple(System.get_env("CROSSCOMPILE"))

  defp remove(folder) do
    _ = File.rm_rf!(folder)
    :ok
  end

  defp crates do
    project = Mix.Project.config()
    app = Keyword.fetch!(project, :app)

    case Crates.new(app, project[:cargo], Application.get_env(app, :programs)) do
      {:ok, crates} -> crates
      {:error, sentence} -> Mix.raise(sentence)
    end
  end

  defp build(%Crates{packages: []}, _triple, _target_dir), do: 0

  defp build(crates, triple, target_dir) do
    {_progress, status} =
      System.cmd(cargo(), arguments(crates, triple, target_dir),
        cd: crates.path,
        env: env(triple, System.get_env()),
        into: %Progress{},
        stderr_to_stdout: true
      )

    status
  end

  # A shell that was opened before Rust was installed has no ~/.cargo/bin in its PATH.
  defp cargo do
    installed = Path.expand("~/.cargo/bin/cargo")

    System.find_executable("cargo") || System.find_executable(installed) ||
      Mix.raise(
        "cannot find cargo in PATH or in ~/.cargo/bin: install Rust with rustup " <>
          "(bin/setup in a checkout of Ganglion does it)"
      )
  end

  defp arguments(crates, triple, target_dir) do
    ["build", "--release"]
    |> Kernel.++(if crates.locked?, do: ["--locked"], else: [])
    |> Kernel.++(["--target-dir", target_dir])
    |> Kernel.++(if IO.ANSI.enabled?(), do: ["--color", "always"], else: [])
    |> Kernel.++(if triple, do: ["--target", triple], else: [])
    |> Kernel.++(Enum.flat_map(crates.packages, &["--package", &1]))
  end

  # Boards with the same triple differ in their flags, and each project cleans its own folder.
  defp target_dir(crates, triple) do
    build_path = Mix.Project.build_path()

    cond do
      given = given_target_dir() -> Path.expand(given, crates.path)
      triple || System.get_env("MIX_BUILD_PATH") -> Path.join([build_path, "native", crates.name])
      crates.name == "ganglion" -> Path.join(Path.dirname(build_path), "cargo")
      true -> Path.join([Path.dirname(build_path), "cargo", crates.name])
    end
  end

  defp given_target_dir do
    with "" <- System.get_env("CARGO_TARGET_DIR"), do: nil
  end

  defp diagnostic(crates, status) do
    %Mix.Task.Compiler.Diagnostic{
      compiler_name: "cargo",
      file: Path.expand("Cargo.toml", crates.path),
      message: "cargo exited with status #{status}; its messages are above",
      position: 0,
      severity: :error
    }
  end
end
