defmodule BB.Parameter.Store.Disk do
  @moduledoc """
  How a store's file is changed so that a power failure at any instant leaves the old one or the
  new one.

  A new file is written beside the old one as `path.new`, brought to the disk, and takes the name
  in one step; the folder, which has the names, is brought to the disk after it. What is renamed
  or made is not there for good before that.
  """

  @type reason :: :file.posix() | :badarg | :terminated

  @links 8
  @numbers 2..9

  @doc "The file for which a path stands: absolute, and where a symbolic link leads."
  @spec resolve(Path.t()) :: Path.t()
  def resolve(path), do: path |> Path.expand() |> follow(@links)

  defp follow(path, 0), do: path

  defp follow(path, links) do
    case File.read_link(path) do
      {:ok, to} -> to |> Path.expand(Path.dirname(path)) |> follow(links - 1)
      {:error, _not_a_link} -> path
    end
  end

  @doc "Makes a folder and those above it, for good."
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

  @doc "A file's bytes, `{:ok, nil}` when there is none. A folder or a device is an error."
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

  @doc "Writes `path.new`, for good. It is gone again when that fails."
  @spec write_new(Path.t(), iodata()) :: :ok | {:error, reason()}
  def write_new(path, bytes) do
    with {:error, reason} <- write(new(path), [:write, :exclusive], &write_all(&1, bytes)) do
      _ = unless reason == :eexist, do: File.rm(new(path))
      if reason == :eexist, do: write_anew(path, bytes), else: {:error, reason}
    end
  end

  # One that a kill left behind. A link there is not followed.
  defp write_anew(path, bytes) do
    with :ok <- File.rm(new(path)),
         do: write(new(path), [:write, :exclusive], &write_all(&1, bytes))
  end

  defp write_all(file, bytes) do
    with :ok <- :file.write(file, bytes), do: :file.sync(file)
  end

  @doc "Gives `path.new` the name `path`, for good."
  @spec replace(Path.t()) :: :ok | {:error, reason()}
  def replace(path) do
    with :ok <- File.rename(new(path), path), do: sync_folder(Path.dirname(path))
  end

  @doc """
  Writes bytes at a place in a file where other bytes are expected, for good. `:changed` when they
  are not there, or the file is not.
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

    # To open a file for writing makes it.
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

  @doc "Gives a file another name too, in the place of what has it."
  @spec keep_as(Path.t(), Path.t()) :: {:ok, Path.t()} | {:error, reason()}
  def keep_as(file, name) do
    beside = new(name)
    _ = File.rm(beside)

    with :ok <- link(file, beside),
         :ok <- File.rename(beside, name) do
      # It stays when the two were one file already.
      _ = File.rm(beside)
      {:ok, name}
    end
  end

  @doc """
  Gives a file another name too, that nobody has: `name`, or `name.2` to `name.9` beside earlier
  ones. When all are taken the last gives way.
  """
  @spec set_aside(Path.t(), Path.t()) :: {:ok, Path.t()} | {:error, reason()}
  def set_aside(file, name) do
    names = [name | Enum.map(@numbers, &"#{name}.#{&1}")]
    free? = &(same?(file, &1) or not exists?(&1))
    keep_as(file, Enum.find(names, List.last(names), free?))
  end

  defp exists?(path), do: match?({:ok, _}, File.lstat(path))

  # The same file by two names, as a start that was broken off leaves it.
  defp same?(path, other) do
    with {:ok, %{inode: inode, major_device: device}} <- File.lstat(path),
         {:ok, %{inode: ^inode, major_device: ^device}} when inode != 0 <- File.lstat(other) do
      true
    else
      _ -> false
    end
  end

  # Not every file system has two names for a file.
  defp link(file, beside) do
    case :file.make_link(file, beside) do
      :ok -> :ok
      {:error, reason} when reason in [:enoent, :enospc, :erofs, :eio] -> {:error, reason}
      {:error, _cannot} -> File.rename(file, beside)
    end
  end

  # Not every file system can bring a folder to the disk by itself.
  defp sync_folder(folder) do
    with {:ok, file} <- :file.open(folder, [:raw, :read, :directory]) do
      synced = :file.sync(file)
      _ = :file.close(file)
      if synced in [{:error, :einval}, {:error, :enotsup}], do: :ok, else: synced
    end
  end

  defp new(path), do: path <> ".new"
end
