defmodule Ganglion.New.Dependency do
  @moduledoc """
  Describes how a new project depends on Ganglion: by the path of a checkout, or by git.

  `Ganglion.New.Options` makes one from the option `--from`, and `Ganglion.New.Templates` writes
  it into the project's files.

      iex> dependency = {:git, "https://host/ganglion.git", "v1"}
      iex> Ganglion.New.Dependency.entry(dependency)
      ~S({:ganglion, git: "https://host/ganglion.git", ref: "v1"})
      iex> Ganglion.New.Dependency.folder(dependency)
      "deps/ganglion"
  """

  @typedoc "The folder of a checkout, relative to the project, or a git repository."
  @type t :: {:path, Path.t()} | {:git, url :: String.t(), ref :: String.t() | nil}

  @doc """
  Parses the value of `--from` for a project at `path`.

  The value is the path of a checkout, or `git:URL`, or `git:URL#REF` with a branch, tag or
  commit. `nil` stands for the checkout that runs. The path in the result is relative to the
  project.
  """
  @spec parse(String.t() | nil, Path.t(), from: Path.t(), checkout: Path.t()) ::
          {:ok, t()} | {:error, String.t()}
  def parse(nil, path, where), do: {:ok, {:path, relative(where[:checkout], path)}}
  def parse("git:" <> rest, _path, where), do: parse_git(String.split(rest, "#", parts: 2), where)

  def parse(folder, path, where) do
    checkout = Path.expand(folder, where[:from])

    if checkout?(checkout),
      do: {:ok, {:path, relative(checkout, path)}},
      else:
        {:error,
         "--from: expected a checkout of Ganglion or git:URL, got: #{inspect(folder)}; " <>
           "#{checkout} has no mix.exs of Ganglion"}
  end

  defp parse_git([""], _where),
    do: {:error, "--from: expected git:URL, such as git:https://host/ganglion.git, got: \"git:\""}

  defp parse_git([url, ""], _where),
    do:
      {:error,
       "--from: expected git:URL#REF with a branch, tag or commit, " <>
         "got: #{inspect("git:#{url}#")}"}

  defp parse_git([url | ref], where) do
    if url =~ ~r/[\s"\\]/ or Enum.any?(ref, &(&1 =~ ~r/[\s"\\]/)),
      do: {:error, "--from: expected git:URL, got: #{inspect("git:" <> url)}"},
      else: {:ok, {:git, absolute(url, where[:from]), List.first(ref)}}
  end

  # Mix runs git in deps/, where a relative path would lead elsewhere.
  defp absolute(url, from) do
    folder = Path.expand(url, from)
    if not (url =~ ":") and File.dir?(folder), do: folder, else: url
  end

  defp checkout?(folder) do
    case File.read(Path.join(folder, "mix.exs")) do
      {:ok, text} -> text =~ ~r/app: :ganglion\b|@app :ganglion\b/
      {:error, _reason} -> false
    end
  end

  # Symbolic links are resolved first: `..` of a link leads to the parent of its target.
  defp relative(checkout, path) do
    remove_common(Path.split(physical(checkout)), Path.split(physical(path)))
  end

  defp remove_common([same | checkout], [same | path]), do: remove_common(checkout, path)
  defp remove_common([], []), do: "."
  defp remove_common(checkout, path), do: Path.join(Enum.map(path, fn _ -> ".." end) ++ checkout)

  defp physical(path) do
    if File.dir?(path),
      do: "pwd" |> System.cmd(["-P"], cd: path) |> elem(0) |> String.trim_trailing("\n"),
      else: Path.join(physical(Path.dirname(path)), Path.basename(path))
  end

  @doc "Returns Ganglion's folder, relative to the project."
  @spec folder(t()) :: Path.t()
  def folder({:path, path}), do: path
  def folder({:git, _url, _ref}), do: "deps/ganglion"

  @doc "Returns the source text of the entry in `deps/0` of `mix.exs`."
  @spec entry(t()) :: String.t()
  def entry({:path, path}), do: ~s({:ganglion, path: #{inspect(path)}})
  def entry({:git, url, nil}), do: ~s({:ganglion, git: #{inspect(url)}})
  def entry({:git, url, ref}), do: ~s({:ganglion, git: #{inspect(url)}, ref: #{inspect(ref)}})
end
