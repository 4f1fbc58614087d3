defmodule Ganglion.New.Options do
  @moduledoc """
  The command line of `mix ganglion.new` and `bin/new`. It writes nothing: it looks at what is there.
  """

  alias Ganglion.New.{Name, Source}

  @switches [module: :string, target: :keep, from: :string, native: :string, help: :boolean]
  @accepted "--module NAME, --target BOARD, --from SOURCE, --native KIND, --help"
  @natives %{"none" => :none, "rust" => :rust, "python" => :python}

  # Ours, so that the file is looked at when a board comes.
  @boards_file "config/boards.exs"
  @external_resource @boards_file
  {boards, _binding} = Code.eval_file(@boards_file)
  @boards boards

  @enforce_keys [:path, :app, :module, :targets, :source, :native]
  defstruct [:path, :app, :module, :targets, :source, :native]

  @typedoc "What to write: where (an absolute path), under which names, for which boards, with Ganglion from where."
  @type t :: %__MODULE__{
          path: Path.t(),
          app: String.t(),
          module: String.t(),
          targets: [atom()],
          source: Source.t(),
          native: :none | :rust | :python
        }

  @doc "The boards that are known, each with its `:system` (a requirement) and its `:rust` target."
  @spec boards() :: keyword([{:system | :rust, String.t()}])
  def boards, do: @boards

  @doc """
  The options of `argv`; relative paths count from `from`, `checkout` is the Ganglion that asks. A mistake is `{:error, sentence}`.
  """
  @spec parse([String.t()], from: Path.t(), checkout: Path.t()) ::
          {:ok, t()} | :help | {:error, String.t()}
  def parse(argv, where) do
    case OptionParser.parse(argv, strict: @switches) do
      {_given, _arguments, [{option, value} | _]} -> {:error, refused(option, value)}
      {given, arguments, []} -> if given[:help], do: :help, else: check(arguments, given, where)
    end
  end

  defp check(arguments, given, where) do
    with {:ok, path} <- path(arguments, where[:from]),
         {:ok, app} <- Name.app(path),
         {:ok, module} <- Name.module(given[:module] || Macro.camelize(app)),
         {:ok, native} <- native(given[:native] || "rust"),
         {:ok, targets} <- targets(Keyword.get_values(given, :target), native),
         {:ok, source} <- Source.parse(given[:from], path, where) do
      {:ok,
       %__MODULE__{
         path: path,
         app: app,
         module: module,
         targets: targets,
         source: source,
         native: native
       }}
    end
  end

  defp refused(option, nil) when option in ["--module", "--target", "--from", "--native"],
    do: "#{option}: expected a value, got nothing; see --help"

  defp refused(option, _value), do: "expected the options #{@accepted}, got: #{option}"

  # The path

  defp path([], _from),
    do: {:error, "expected the PATH of the new project, got nothing; try: bin/new ../rover"}

  defp path([path], from) do
    path = Path.expand(path, from)

    case File.ls(path) do
      {:error, :enoent} -> writable(path)
      {:ok, []} -> {:ok, path}
      {:ok, _files} -> {:error, taken("a new path or an empty folder", path)}
      {:error, :enotdir} -> {:error, taken("a path below folders", path)}
      {:error, reason} -> {:error, "#{path} cannot be read: #{:file.format_error(reason)}"}
    end
  end

  defp path([_path, extra | _], _from),
    do: {:error, "expected one PATH, got one more: #{extra}; options begin with --"}

  defp taken(expected, path),
    do: "expected #{expected}, got: #{path}, which is there already; choose another or remove it"

  # The first folder above it that is there has to take it.
  defp writable(path) do
    above = path |> Stream.iterate(&Path.dirname/1) |> Enum.find(&File.exists?/1)

    case File.stat(above) do
      {:ok, %{type: :directory, access: access}} when access in [:write, :read_write] ->
        {:ok, path}

      {:ok, %{type: :directory}} ->
        {:error,
         "expected a path that can be written, got: #{path}; you may not write to #{above}"}

      _no_folder ->
        {:error, taken("a path below folders", above)}
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
         "--native python: no Nerves system carries Python, and --target asks for " <>
           "#{Enum.join(names, ", ")}; leave --target out, or take --native rust"}

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
