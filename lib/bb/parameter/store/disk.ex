defmodule BB.Parameter.Store.Disk do
  @moduledoc """
  Changes the file of a store so that a power failure at any instant leaves the old file or the
  new one. `BB.Parameter.Store.Log` and `BB.Parameter.Store.Dets` use it.

  A new file is written beside the old one as `path.new`, synced, and renamed in one step. Then
  the folder is synced: a file that is made or renamed survives a power failure only after that.

      :ok = BB.Parameter.Store.Disk.write_new("/data/params", bytes)
      :ok = BB.Parameter.Store.Disk.replace("/data/params")
  """

  @type reason :: :file.posix() | :badarg | :terminated

  @links 8
  @numbers 2..9

  @doc "Resolves a path: makes it absolute and follows symbolic links."
  @spec resolve(Path.t()) :: Path.t()
  def resolve(path), do: path |> Path.expand() |> follow_links(@links)

  defp follow_links(path, 0), do: path

  defp follow_links(path, links) do
    case File.read_link(path) do
      {:ok, to} -> to |> Path.expand(Path.dirname(path)) |> follow_links(links - 1)
      {:error, _not_a_link} -> path
    end
  end

  @doc "Makes a folder and the folders above it, and syncs them."
  @spec make_folder(Path.t()) :: :ok | {:error, reason()}
  def make_folder(folder) do
    case File.stat(folder) do
      {:ok, %{type: :directory}} -> :ok
      {:ok, _no_folder} -> {:error, :enotdir}
      {:error, :enoent} -> make_missing(folder, Path.dirname(folder))
      {:error, reason} -> {:error, reason}
    end
  end

  defp make_missing(folder, folder), do: {:error, :enoent}

  defp make_missing(folder, above) do
    with :ok <- make_folder(above),
         :ok <- File.mkdir(folder),
         do: sync_folder(above)
  end

  @doc "Reads a file: `{:ok, nil}` when it does not exist. A folder or a device is an error."
  @spec read(Path.t(), pos_integer()) :: {:ok, binary() | nil} | {:error, reason()}
  def read(path, largest) do
    case File.stat(path) do
      {:ok, %{type: :regular, size: size}} when size > largest -> {:error, :efbig}
      {:ok, %{type: :regular}} -> File.read(path)
      {:ok, %{type: :directory}} -> {:error, :eisdir}
      {:ok, _device} -> {:error, :einval}
      {:error, :enoent} -> {:ok, nil}
      {:error, reason} -> {:error, reason}
    end
  end

  @doc "Writes and syncs `path.new`. Removes it when that fails."
  @spec write_new(Path.t(), iodata()) :: :ok | {:error, reason()}
  def write_new(path, bytes) do
    with {:error, reason} <- write(new(path), [:write, :exclusive], &write_all(&1, bytes)) do
      _ = unless reason == :eexist, do: File.rm(new(path))
      if reason == :eexist, do: rewrite_new(path, bytes), else: {:error, reason}
    end
  end

  # A kill has left `path.new` behind. A link of that name is not followed.
  defp rewrite_new(path, bytes) do
    with :ok <- File.rm(new(path)),
         do: write(new(path), [:write, :exclusive], &write_all(&1, bytes))
  end

  defp write_all(file, bytes) do
    with :ok <- :file.write(file, bytes), do: :file.sync(file)
  end

  @doc "Renames `path.new` to `path`, and syncs the folder."
  @spec replace(Path.t()) :: :ok | {:error, reason()}
  def replace(path) do
    with :ok <- File.rename(new(path), path), do: sync_folder(Path.dirname(path))
  end

  @doc """
  Overwrites the bytes `expected` at a place in a file, and syncs it. Returns `:changed` when the
  file has other bytes at that place, or does not exist.
  """
  @spec overwrite(Path.t(), non_neg_integer(), binary(), iodata()) ::
          :ok | :changed | {:error, reason()}
  def overwrite(path, at, expected, bytes) do
    overwrite = fn file ->
      case :file.pread(file, at, byte_size(expected)) do
        {:ok, ^expected} -> write_at(file, at, bytes)
        {:error, reason} -> {:error, reason}
        _other -> :changed
      end
    end

    # Opening a missing file for writing would make it.
    if File.exists?(path), do: write(path, [:read, :write], overwrite), else: :changed
  end

  defp write_at(file, at, bytes) do
    with :ok <- :file.pwrite(file, at, bytes), do: :file.datasync(file)
  end

  defp write(path, modes, fun) do
    with {:ok, file} <- :file.open(path, [:raw, :binary | modes]) do
      result = fun.(file)
      closed = :file.close(file)
      if result == :ok, do: closed, else: result
    end
  end

  @doc "Adds another name to a file, and replaces the file with that name."
  @spec keep_as(Path.t(), Path.t()) :: {:ok, Path.t()} | {:error, reason()}
  def keep_as(file, name) do
    beside = new(name)
    _ = File.rm(beside)

    with :ok <- link(file, beside),
         :ok <- File.rename(beside, name) do
      # The rename does nothing when both names are the same file already.
      _ = File.rm(beside)
      {:ok, name}
    end
  end

  @doc """
  Adds a free name to a file: `name`, or `name.2` to `name.9` beside earlier files. Replaces the
  last when all names are taken.
  """
  @spec set_aside(Path.t(), Path.t()) :: {:ok, Path.t()} | {:error, reason()}
  def set_aside(file, name) do
    names = [name | Enum.map(@numbers, &"#{name}.#{&1}")]
    free? = &(same?(file, &1) or not exists?(&1))
    keep_as(file, Enum.find(names, List.last(names), free?))
  end

  defp exists?(path), do: match?({:ok, _}, File.lstat(path))

  # One file with two names, which an interrupted start leaves behind.
  defp same?(path, other) do
    with {:ok, %{inode: inode, major_device: device}} <- File.lstat(path),
         {:ok, %{inode: ^inode, major_device: ^device}} when inode != 0 <- File.lstat(other) do
      true
    else
      _ -> false
    end
  end

  # Some file systems have no hard links.
  defp link(file, beside) do
    case :file.make_link(file, beside) do
      :ok -> :ok
      {:error, reason} when reason in [:enoent, :enospc, :erofs, :eio] -> {:error, reason}
      {:error, _cannot} -> File.rename(file, beside)
    end
  end

  # Some file systems cannot sync a folder.
  defp sync_folder(folder) do
    with {:ok, file} <- :file.open(folder, [:raw, :read, :directory]) do
      synced = :file.sync(file)
      _ = :file.close(file)
      if synced in [{:error, :einval}, {:error, :enotsup}], do: :ok, else: synced
    end
  end

  defp new(path), do: path <> ".new"
end
