defmodule Mix.Tasks.Compile.Cargo.Priv do
  @moduledoc """
  Puts what cargo has built into the `priv` of the project's application, and takes out again what
  is not built any more.

  A manifest beside those of Mix's own compilers has what was put there, so that nothing is copied
  twice, and nothing removed that somebody else has put there.
  """

  @manifest "compile.cargo"

  @doc """
  Installs files, `{name in the folder built, name in priv}`. `{:ok, []}` when anything was done,
  else `{:noop, []}`.
  """
  @spec install([{String.t(), String.t()}], Path.t()) :: {:ok | :noop, []}
  def install(files, built) do
    before = read()
    now = Map.new(files, fn {from, to} -> {to, put(Path.join(built, from), to, before[to])} end)
    gone = Map.keys(before) -- Map.keys(now)
    Enum.each(gone, &File.rm(path(&1)))
    _ = unless now == before, do: write(now)
    {if(now == before, do: :noop, else: :ok), []}
  end

  @doc "Removes what was installed."
  @spec remove() :: :ok
  def remove do
    Enum.each(Map.keys(read()), &File.rm(path(&1)))
    _ = File.rm(manifest())
    :ok
  end

  # A running program or a loaded NIF keeps its old file: the new one takes its name.
  defp put(from, to, kept) do
    to = path(to)
    built = mark(from) || Mix.raise(missing(from))

    if kept != {built, mark(to)} do
      File.mkdir_p!(Path.dirname(to))
      File.cp!(from, to <> ".new")
      File.rename!(to <> ".new", to)
    end

    {built, mark(to)}
  end

  defp missing(from) do
    "cargo was asked for #{Path.basename(from)} and built no such file: look at the names in " <>
      "`cargo:` of mix.exs and in the package's Cargo.toml (a NIF is a `cdylib`)"
  end

  # What changes whenever a file is made anew.
  defp mark(file) do
    case File.stat(file, time: :posix) do
      {:ok, stat} -> {stat.size, stat.mtime, stat.inode}
      {:error, _reason} -> nil
    end
  end

  defp read do
    with {:ok, binary} <- File.read(manifest()),
         do: :erlang.binary_to_term(binary),
         else: (_ -> %{})
  rescue
    ArgumentError -> %{}
  end

  defp write(installed) do
    File.mkdir_p!(Path.dirname(manifest()))
    File.write!(manifest(), :erlang.term_to_binary(installed))
  end

  defp manifest, do: Path.join(Mix.Project.manifest_path(), @manifest)
  defp path(name), do: Path.join([Mix.Project.app_path(), "priv", name])
end
