defmodule Mix.Tasks.Compile.Cargo.Priv do
  @moduledoc """
  Installs files that cargo has built in the `priv` of the project's application.

  `Mix.Tasks.Compile.Cargo` calls it after each build. It also removes files that are no longer
  built. A manifest beside the manifests of Mix's own compilers lists the installed files, so that
  none is copied twice and files from elsewhere stay.

      Mix.Tasks.Compile.Cargo.Priv.install([{"camera", "bin/camera"}], "_build/cargo/release")
      #=> {:ok, []}
  """

  @manifest "compile.cargo"

  @doc """
  Installs files from the folder `built`, as `{name in that folder, name in priv}`.

  Returns `{:ok, []}` if it changed anything, and `{:noop, []}` if not.
  """
  @spec install([{String.t(), String.t()}], Path.t()) :: {:ok | :noop, []}
  def install(files, built) do
    before = read()
    now = Map.new(files, fn {from, to} -> {to, copy(Path.join(built, from), to, before[to])} end)
    gone = Map.keys(before) -- Map.keys(now)
    Enum.each(gone, &File.rm(path(&1)))
    _ = unless now == before, do: write(now)
    {if(now == before, do: :noop, else: :ok), []}
  end

  @doc "Removes all installed files."
  @spec remove() :: :ok
  def remove do
    Enum.each(Map.keys(read()), &File.rm(path(&1)))
    _ = File.rm(manifest())
    :ok
  end

  # The new file replaces the name, so that a running program or a loaded NIF keeps its old file.
  defp copy(from, to, installed) do
    to = path(to)
    built = fingerprint(from) || Mix.raise(missing(from))

    if installed != {built, fingerprint(to)} do
      File.mkdir_p!(Path.dirname(to))
      File.cp!(from, to <> ".new")
      File.rename!(to <> ".new", to)
    end

    {built, fingerprint(to)}
  end

  defp missing(from) do
    "cargo built no file #{Path.basename(from)}: compare the names in `cargo:` of mix.exs " <>
      "with those in the package's Cargo.toml (a NIF is a `cdylib`)"
  end

  # It changes whenever the file is written again.
  defp fingerprint(file) do
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
