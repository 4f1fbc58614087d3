defmodule Mix.Tasks.Compile.Cargo do
  @shortdoc "Builds a project's Rust crates and puts them into its priv"
  @moduledoc """
  A Mix compiler for the crates of a project: runs cargo on them, and puts what it built into the
  application's `priv`, the programs into `priv/bin`. Ganglion builds its own crates by it, and so
  can every project that depends on Ganglion:

      def project do
        [
          app: :rover,
          compilers: Mix.compilers() ++ [:cargo],
          cargo: [path: "native", programs: ["detector"]],
          ...
        ]
      end

  A program is then found by `program: {:rover, "detector"}` of `BB.Sensor.NativeProcess`.

  ## Options

  The keyword list `cargo:` of `project/0`:

    * `path:` - the folder with the `Cargo.toml` of the crate or workspace, from the project's own;
      `"native"` by default
    * `programs:` - the programs to build, by the names of their packages; `{"tools", "detector"}`
      is the program `detector` of a package that has another name
    * `always:` - programs that are built whatever the configuration asks for
    * `nif:` - the package of a NIF's library, or a list of them, `nil` by default; it becomes
      `priv/<name>.so`
    * `locked:` - whether a `Cargo.lock` that does not fit is an error (`false`)

  Which of `programs:` are built is asked for by the configuration of the application, at compile
  time; without it, all are:

      config :rover, programs: [:detector]
      config :ganglion, programs: []

  A program that is not asked for any more disappears from `priv`.

  ## What it does

  cargo itself says what there is to build; its progress is shown on standard error. When there is
  nothing, nothing is printed and nothing copied, and the compiler returns `:noop`. The builds are
  optimised (`--release`) whatever Mix's environment, and lie below Mix's build folder, so that the
  source tree stays clean: in `cargo/` there for the machine that builds, which all environments
  share, and in the target's build path for a board. `CARGO_TARGET_DIR` names another folder.

  A target build follows Nerves' toolchain: the basename of `CROSSCOMPILE` names the Rust triple
  (`triple/1`), `CC` is the linker and the compiler of C sources inside crates (`env/2`).
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
    # A folder that others have named may have more in it than what was built here.
    if given_target_dir() == nil, do: remove(target_dir(crates, toolchain())), else: :ok
  end

  @doc """
  The Rust target triple of a Nerves toolchain prefix (`CROSSCOMPILE`); `nil` is the machine that
  builds.
  """
  @spec triple(String.t() | nil) :: String.t() | nil
  def triple(nil), do: nil

  def triple(crosscompile) do
    name = Path.basename(crosscompile)

    Map.get(@triples, name) ||
      Mix.raise(
        "no Rust target is known for the toolchain #{inspect(name)} (CROSSCOMPILE); " <>
          "known: #{Enum.join(Map.keys(@triples), ", ")}"
      )
  end

  @doc """
  What cargo's environment needs for `triple`, given the environment of Mix: `{name, value}` sets,
  `{name, nil}` removes.

  The flags of the cross compiler are given by the triple's own names. Under their plain names they
  would reach the build scripts too, which run on the machine that builds.
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
      {:error, mistake} -> Mix.raise(mistake)
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

  # A shell that was open before Rust was installed does not know it.
  defp cargo do
    installed = Path.expand("~/.cargo/bin/cargo")

    System.find_executable("cargo") || System.find_executable(installed) ||
      Mix.raise(
        "cargo was not found, neither in PATH nor in ~/.cargo/bin: install Rust by rustup " <>
          "(in Ganglion's own tree bin/setup does it)"
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

  # Boards of one triple differ in their flags. A project and what it depends on clean up apart.
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
      message: "cargo ended with status #{status}; what it said stands above",
      position: 0,
      severity: :error
    }
  end
end
