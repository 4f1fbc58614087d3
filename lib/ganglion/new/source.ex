defmodule Ganglion.New.Source do
  @moduledoc """
  Where a new project has Ganglion from: a folder, or a git repository.
  """

  @type t :: {:path, Path.t()} | {:git, url :: String.t(), ref :: String.t() | nil}

  @doc """
  The source that `--from` names for a project at `path`: the path of a checkout, or `git:URL`, with `#REF` for a branch, tag or
  commit. Without it, it is the checkout that asks. A folder's path is told as the project sees it.
  """
  @spec parse(String.t() | nil, Path.t(), from: Path.t(), checkout: Path.t()) ::
          {:ok, t()} | {:error, String.t()}
  def parse(nil, path, where), do: {:ok, {:path, relative(where[:checkout], path)}}
  def parse("git:" <> rest, _path, where), do: git(String.split(rest, "#", parts: 2), where)

  def parse(folder, path, where) do
    checkout = Path.expand(folder, where[:from])

    if checkout?(checkout),
      do: {:ok, {:path, relative(checkout, path)}},
      else:
        {:error,
         "--from: expected a checkout of Ganglion or git:URL, got: #{inspect(folder)}; " <>
           "there is none at #{checkout}"}
  end

  defp git([""], _where),
    do: {:error, "--from: expected git:URL, such as git:https://host/ganglion.git, got: \"git:\""}

  defp git([url, ""], _where),
    do:
      {:error,
       "--from: expected git:URL#REF, got: #{inspect("git:#{url}#")}; name a branch, tag or commit"}

  defp git([url | ref], where) do
    if url =~ ~r/[\s"\\]/ or Enum.any?(ref, &(&1 =~ ~r/[\s"\\]/)),
      do: {:error, "--from: expected git:URL, got: #{inspect("git:" <> url)}"},
      else: {:ok, {:git, local(url, where[:from]), List.first(ref)}}
  end

  # Git would look for a relative one elsewhere.
  defp local(url, from) do
    folder = Path.expand(url, from)
    if not (url =~ ":") and File.dir?(folder), do: folder, else: url
  end

  defp checkout?(folder) do
    case File.read(Path.join(folder, "mix.exs")) do
      {:ok, text} -> text =~ ~r/app: :ganglion\b|@app :ganglion\b/
      {:error, _reason} -> false
    end
  end

  # Both as they lie on the disk: `..` of a symbolic link is not where it seems to be.
  defp relative(checkout, path) do
    climb(Path.split(physical(checkout)), Path.split(physical(path)))
  end

  defp climb([same | checkout], [same | path]), do: climb(checkout, path)
  defp climb([], []), do: "."
  defp climb(checkout, path), do: Path.join(Enum.map(path, fn _ -> ".." end) ++ checkout)

  defp physical(path) do
    if File.dir?(path),
      do: "pwd" |> System.cmd(["-P"], cd: path) |> elem(0) |> String.trim_trailing("\n"),
      else: Path.join(physical(Path.dirname(path)), Path.basename(path))
  end

  @doc "Ganglion's folder, as seen from the project's."
  @spec folder(t()) :: Path.t()
  def folder({:path, path}), do: path
  def folder({:git, _url, _ref}), do: "deps/ganglion"

  @doc "The dependency, as `mix.exs` has it."
  @spec dependency(t()) :: String.t()
  def dependency({:path, path}), do: ~s({:ganglion, path: #{inspect(path)}})
  def dependency({:git, url, nil}), do: ~s({:ganglion, git: #{inspect(url)}})

  def dependency({:git, url, ref}),
    do: ~s({:ganglion, git: #{inspect(url)}, ref: #{inspect(ref)}})
end
