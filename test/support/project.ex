defmodule BB.Test.Project do
  @moduledoc """
  Projects outside of this checkout that depend on Ganglion, built and run by their own commands.

  Cargo's builds of a project are kept in this checkout's `_build`, so that a second run of a test
  has little to build. A project by path shares the build of the checkout, because it has the same
  crates at the same path.
  """

  alias BB.Test.Run

  @checkout Path.expand("../..", __DIR__)

  @enforce_keys [:folder, :cargo]
  defstruct [:folder, :cargo]

  @type t :: %__MODULE__{folder: Path.t(), cargo: Path.t()}

  @typedoc "How a project depends on Ganglion."
  @type how :: :path | :git

  @doc "Returns this checkout."
  @spec checkout() :: Path.t()
  def checkout, do: @checkout

  @doc """
  Returns a folder outside of the checkout that is removed when the test, or its module, ends.
  """
  @spec folder(String.t()) :: Path.t()
  def folder(label) do
    folder = Path.join(System.tmp_dir!(), Run.unique(label))
    File.mkdir_p!(folder)
    ExUnit.Callbacks.on_exit(fn -> File.rm_rf!(folder) end)
    folder
  end

  @doc "Returns a project in a folder, which may be empty."
  @spec in_folder(Path.t(), how()) :: t()
  def in_folder(folder, how), do: %__MODULE__{folder: folder, cargo: cargo(how)}

  defp cargo(:path), do: Path.join(@checkout, "_build/cargo")
  defp cargo(:git), do: Path.join(@checkout, "_build/project")

  @doc "Writes files of a project: `{path, text}`."
  @spec write!(t(), [{Path.t(), String.t()}]) :: t()
  def write!(project, files) do
    for {path, text} <- files, file = Path.join(project.folder, path) do
      File.mkdir_p!(Path.dirname(file))
      File.write!(file, text)
    end

    project
  end

  @doc """
  Clones this checkout, with uncommitted changes committed, and returns the address for `git:`.
  """
  @spec clone!(Path.t()) :: String.t()
  def clone!(folder) do
    git!(["clone", "--quiet", "--no-hardlinks", @checkout, folder], @checkout)
    # The checkout may be of a commit, as in CI. Mix clones only what has a branch.
    git!(~w(checkout --quiet -B main), folder)
    for file <- git_files(~w(--deleted)), do: File.rm(Path.join(folder, file))

    for file <- git_files(~w(--modified --others --exclude-standard)),
        File.regular?(Path.join(@checkout, file)) do
      File.mkdir_p!(Path.dirname(Path.join(folder, file)))
      File.cp!(Path.join(@checkout, file), Path.join(folder, file))
    end

    identity = ~w(-c user.name=test -c user.email=test@localhost -c commit.gpgsign=false)
    git!(["add", "--all"], folder)
    git!(identity ++ ~w(commit --quiet --allow-empty --message) ++ ["As it stands"], folder)
    "file://" <> folder
  end

  defp git_files(options) do
    ["ls-files", "-z" | options] |> git!(@checkout) |> String.split("\0", trim: true)
  end

  defp git!(args, folder) do
    case System.cmd("git", args, cd: folder, stderr_to_stdout: true) do
      {text, 0} -> text
      {text, status} -> raise "git #{Enum.join(args, " ")} ended with #{status}: #{text}"
    end
  end

  @doc """
  Runs a command in the project, and returns its output on both streams and its exit status.
  """
  @spec run(t(), String.t(), [String.t()], [{String.t(), String.t() | nil}]) ::
          {String.t(), non_neg_integer()}
  def run(project, command, args, env \\ []) do
    System.cmd(command, args,
      cd: project.folder,
      env: environment(project) ++ env,
      stderr_to_stdout: true
    )
  end

  @doc "Runs a command that has to succeed, and returns its output."
  @spec run!(t(), String.t(), [String.t()], [{String.t(), String.t() | nil}]) :: String.t()
  def run!(project, command, args, env \\ []) do
    case run(project, command, args, env) do
      {text, 0} -> text
      {text, status} -> raise "#{command} #{Enum.join(args, " ")} ended with #{status}:\n#{text}"
    end
  end

  # A person's environment: without the variables that Mix and bin/test export to their children.
  @exported ~w(MIX_ENV MIX_TARGET MIX_EXS MIX_BUILD_PATH MIX_DEPS_PATH GANGLION_CALLER_DIR)

  defp environment(project) do
    for(name <- @exported, do: {name, nil}) ++
      [{"CARGO_TARGET_DIR", project.cargo}, {"LC_ALL", "C.UTF-8"}]
  end

  @doc """
  Returns the chunks of an application's beam files that contain one of these texts: `{file,
  chunk, text}`.

  It skips the chunks for debuggers, which no program reads and which a release strips: the
  compiler's record (`CInf`) and debug information (`Dbgi`).
  """
  @spec baked(Path.t(), [String.t()]) :: [{Path.t(), String.t(), String.t()}]
  def baked(ebin, texts) do
    for file <- Path.wildcard(Path.join(ebin, "*.beam")),
        {:ok, _module, chunks} = :beam_lib.all_chunks(File.read!(file)),
        {name, binary} <- chunks,
        name not in [~c"CInf", ~c"Dbgi"],
        text <- texts,
        contains?(plain(name, binary), text),
        do: {Path.basename(file), to_string(name), text}
  end

  defp contains?(binary, text), do: :binary.match(binary, text) != :nomatch

  # Literals and documentation are compressed.
  defp plain(~c"LitT", <<size::32, packed::binary>>) when size > 0, do: :zlib.uncompress(packed)

  defp plain(~c"Docs", binary),
    do: binary |> :erlang.binary_to_term() |> :erlang.term_to_binary()

  defp plain(_name, binary), do: binary
end
