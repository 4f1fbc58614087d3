defmodule Ganglion.New.Options do
  @moduledoc """
  Parses the command line of `mix ganglion.new` and `bin/new`.

  `Ganglion.New` uses it. It reads the file system and writes nothing.

      where = [from: File.cwd!(), checkout: File.cwd!()]
      {:ok, options} = Ganglion.New.Options.parse(["../rover", "--native", "none"], where)
      options.module
      #=> "Rover"
  """

  alias Ganglion.New.{Dependency, Name}

  @switches [module: :string, target: :keep, from: :string, native: :string, help: :boolean]
  @accepted "--module NAME, --target BOARD, --from SOURCE, --native KIND, --help"
  @natives %{"none" => :none, "rust" => :rust, "python" => :python}

  # The module is compiled again when the file changes.
  @boards_file "config/boards.exs"
  @external_resource @boards_file
  {boards, _binding} = Code.eval_file(@boards_file)
  @boards boards

  @enforce_keys [:path, :app, :module, :targets, :dependency, :native]
  defstruct [:path, :app, :module, :targets, :dependency, :native]

  @typedoc "The project to write. `path` is absolute."
  @type t :: %__MODULE__{
          path: Path.t(),
          app: String.t(),
          module: String.t(),
          targets: [atom()],
          dependency: Dependency.t(),
          native: :none | :rust | :python
        }

  @doc "Returns the supported boards, each with its `:system` requirement and `:rust` target."
  @spec boards() :: keyword([{:system | :rust, String.t()}])
  def boards, do: @boards

  @doc """
  Parses `argv`. Invalid arguments return `{:error, sentence}`.

  Relative paths are relative to `from`; `checkout` is the folder of the Ganglion that runs.
  """
  @spec parse([String.t()], from: Path.t(), checkout: Path.t()) ::
          {:ok, t()} | :help | {:error, String.t()}
  def parse(argv, where) do
    case OptionParser.parse(argv, strict: @switches) do
      {_given, _arguments, [{option, value} | _]} -> {:error, format_invalid(option, value)}
      {given, arguments, []} -> if given[:help], do: :help, else: build(arguments, given, where)
    end
  end

  defp build(arguments, given, where) do
    with {:ok, path} <- path(arguments, where[:from]),
         {:ok, app} <- Name.app(path),
         {:ok, module} <- Name.module(given[:module] || Macro.camelize(app)),
         {:ok, native} <- native(given[:native] || "rust"),
         {:ok, targets} <- targets(Keyword.get_values(given, :target), native),
         {:ok, dependency} <- Dependency.parse(given[:from], path, where) do
      {:ok,
       %__MODULE__{
         path: path,
         app: app,
         module: module,
         targets: targets,
         dependency: dependency,
         native: native
       }}
    end
  end

  defp format_invalid(option, nil) when option in ["--module", "--target", "--from", "--native"],
    do: "#{option}: expected a value, got nothing; see --help"

  defp format_invalid(option, _value),
    do: "unknown option #{option}; expected one of #{@accepted}"

  # The path

  defp path([], _from),
    do: {:error, "expected the PATH of the new project, got nothing; try: bin/new ../rover"}

  defp path([path], from) do
    path = Path.expand(path, from)

    case File.ls(path) do
      {:error, :enoent} -> writable(path)
      {:ok, []} -> {:ok, path}
      {:ok, _files} -> {:error, format_taken("a new path or an empty folder", path)}
      {:error, :enotdir} -> {:error, format_taken("a path below folders", path)}
      {:error, reason} -> {:error, "could not read #{path}: #{:file.format_error(reason)}"}
    end
  end

  defp path([_path, extra | _], _from),
    do: {:error, "expected one PATH, got one more: #{extra}; options begin with --"}

  defp format_taken(expected, path),
    do: "expected #{expected}, got: #{path}, which exists already; choose another or remove it"

  # The nearest existing folder above the path has to be writable.
  defp writable(path) do
    above = path |> Stream.iterate(&Path.dirname/1) |> Enum.find(&File.exists?/1)

    case File.stat(above) do
      {:ok, %{type: :directory, access: access}} when access in [:write, :read_write] ->
        {:ok, path}

      {:ok, %{type: :directory}} ->
        {:error, "expected a writable path, got: #{path}; you may not write to #{above}"}

      _no_folder ->
        {:error, format_taken("a path below folders", above)}
    end
  end

  # Boards

  defp targets([], :python), do: {:ok, []}
  defp targets([], _native), do: {:ok, Keyword.keys(@boards)}

  defp targets(given, native) do
    names = given |> Enum.flat_map(&String.split(&1, ",")) |> Enum.map(&String.trim/1)
    known = Map.new(@boards, fn {board, _} -> {Atom.to_string(board), board} end)

    cond do
      unknown = Enum.find(names, &(not Map.has_key?(known, &1))) ->
        {:error, "--target: expected #{known_boards()}, got: #{inspect(unknown)}"}

      native == :python ->
        {:error,
         "--native python: no Nerves system carries Python, got also --target " <>
           "#{Enum.join(names, ",")}; leave --target out, or use --native rust"}

      true ->
        {:ok, names |> Enum.uniq() |> Enum.map(&known[&1])}
    end
  end

  defp known_boards,
    do: "one or more of " <> Enum.map_join(@boards, ", ", &to_string(elem(&1, 0)))

  # The native process

  defp native(name) do
    with :error <- Map.fetch(@natives, name),
         do: {:error, "--native: expected none, rust or python, got: #{inspect(name)}"}
  end
end
