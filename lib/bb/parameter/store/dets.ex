defmodule BB.Parameter.Store.Dets do
  @moduledoc """
  Keeps parameters in a file by OTP's `:dets`, for robots that have such a file.
  `BB.Parameter.Store.Log` keeps more promises, and takes the file over when it gets the same
  `path:`.

      settings do
        parameter_store {BB.Parameter.Store.Dets, path: "/data/params"}
      end

  Values are on the disk when `BB.Parameter.set/3` or `set_many/2` returns. That takes two syncs. A
  file that was not closed, because the
  power failed, is repaired when it is opened. One that is beyond repair, or from which values are
  missing after it, is kept as `path.corrupt` (`path.corrupt.2` to `.9` beside earlier ones), with a
  warning and the alarm `{BB.Parameter, robot, :damaged}`; it never keeps the robot from starting.
  Folders above `path` are made when they are missing.

  DETS has no checksums, so these do not hold for it:

    * After a kill in the midst of a change, DETS's repair may bring an older row back: part of a
      `set_many/2` may be there, without the rest. It is rare.
    * A wrong byte in a value may go unnoticed, and so may a value that is missing from a file
      that was not closed.
    * A power failure while a value is written may cost that value and the one before it.
    * There is no generation before: what is lost is lost.
  """

  @behaviour BB.Parameter.Store

  require Logger

  alias BB.Parameter.Store
  alias BB.Parameter.Store.Disk

  # As OTP writes the head of a file: 4 bytes each, the second says what it is, the ninth has the
  # number of rows.
  @cookie 0x00ABCDEF
  @copy ".import"

  # The row of the latest change. A kill may have left some of its values as they were before.
  @latest :latest

  @doc "Opens the file at `path:`, or makes it with the folders above it."
  @impl BB.Parameter.Store
  def init(robot, opts) do
    with {:ok, opts} <- BB.Options.validate(opts, path: [type: :string, required: true]),
         file = Path.expand(opts[:path]),
         :ok <- Disk.make_folder(Path.dirname(file)),
         do: open(robot, file)
  end

  @doc "The values, in the rows of this library and of Beam Bots."
  @impl BB.Parameter.Store
  def load(%{table: table}) do
    with {:ok, rows} <- rows(table), do: {:ok, pairs(rows)}
  end

  @doc "Stores a value."
  @impl BB.Parameter.Store
  def save(store, path, value), do: save_many(store, [{path, value}])

  @doc "Stores values, all or none: first as one row, then each in its own."
  @impl BB.Parameter.Store
  def save_many(%{table: table, file: file}, values) do
    with :ok <- reopen(table, file, :dets.info(table)),
         :ok <- insert(table, values) do
      :ok
    else
      {:error, reason} ->
        # After an error of the file a table takes nothing any more, until it is opened anew.
        _ = :dets.close(table)
        {:error, plain(reason)}
    end
  end

  defp reopen(table, file, :undefined),
    do: with({:ok, ^table, _rows} <- open_table(table, file), do: :ok)

  defp reopen(_table, _file, _info), do: :ok

  defp insert(table, values) do
    with :ok <- :dets.insert(table, {@latest, values}),
         :ok <- :dets.sync(table),
         :ok <- :dets.insert(table, values),
         do: :dets.sync(table)
  end

  @doc "What was found damaged when the file was opened, or `nil`."
  @impl BB.Parameter.Store
  def damage(store), do: store.damage

  @doc "Closes the file."
  @impl BB.Parameter.Store
  def close(%{table: table}), do: :dets.close(table)

  @doc "Whether there is a file of DETS at a path."
  @spec file?(Path.t()) :: boolean()
  def file?(path), do: :dets.is_dets_file(to_charlist(path)) == true

  @doc """
  The values in a file, which is left as it is, and how many are missing; for a store that takes
  it over.
  """
  @spec read(Path.t()) ::
          {:ok, [{BB.Parameter.path(), term()}], non_neg_integer() | :unknown} | {:error, term()}
  def read(path) do
    copy = path <> @copy

    with {:ok, _bytes} <- File.copy(path, copy),
         {:ok, table, rows} <- open_table(copy, copy) do
      _ = :dets.close(table)
      {:ok, pairs(rows), missing(counted(path), rows)}
    else
      {:error, reason} -> {:error, plain(reason)}
    end
  catch
    # OTP's own code, on bytes that may be anything.
    kind, reason -> {:error, {kind, reason}}
  after
    remove_copy(path)
  end

  # To open a damaged file changes it, so what may have to be kept is a copy. On a full disk there
  # is none.
  defp open(robot, file) do
    copy =
      if File.regular?(file) and match?({:ok, _}, File.copy(file, file <> @copy)),
        do: file <> @copy

    open(robot, file, copy)
  after
    remove_copy(file)
  end

  defp open(robot, file, copy) do
    counted = counted(file)

    case open_table({__MODULE__, robot}, file) do
      {:ok, table, rows} ->
        {:ok, %{table: table, file: file, damage: check(robot, file, copy, counted, rows)}}

      {:error, reason} ->
        begin_anew(robot, file, copy, plain(reason))
    end
  end

  defp check(robot, file, copy, counted, rows) do
    lost = missing(counted, rows)
    if lost != 0, do: damage(robot, file, copy, lost)
  end

  # What the file system says is an atom, such as :eacces: nothing is wrong with the file's
  # content then.
  defp begin_anew(_robot, _file, _copy, reason) when is_atom(reason), do: {:error, reason}

  defp begin_anew(robot, file, copy, reason) do
    if File.regular?(file),
      do: replace(robot, file, copy || file),
      else: {:error, reason}
  end

  defp replace(robot, file, copy) do
    damage = damage(robot, file, copy, :unknown)

    with :ok <- File.rm(file),
         {:ok, table, _rows} <- open_table({__MODULE__, robot}, file) do
      {:ok, %{table: table, file: file, damage: damage}}
    else
      {:error, reason} -> {:error, plain(reason)}
    end
  end

  defp remove_copy(file), do: File.rm(file <> @copy)

  # A file can be opened and yet have garbage in it, which a reader meets.
  defp open_table(name, file) do
    with {:ok, table} <- :dets.open_file(name, file: to_charlist(file), type: :set) do
      case rows(table) do
        {:ok, rows} ->
          {:ok, table, rows}

        {:error, reason} ->
          _ = :dets.close(table)
          {:error, reason}
      end
    end
  end

  defp rows(table) do
    case :dets.foldl(&[&1 | &2], [], table) do
      rows when is_list(rows) -> {:ok, rows}
      {:error, reason} -> {:error, reason}
    end
  end

  # The rows of Beam Bots, then ours, then the latest change: the later go before the earlier.
  defp pairs(rows) do
    theirs = for {{:param, [_ | _] = path}, value} <- rows, do: {path, value}
    ours = for {[_ | _] = path, value} <- rows, do: {path, value}
    latest = for {@latest, values} when is_list(values) <- rows, pair <- values, do: pair
    Map.to_list(Map.new(theirs ++ ours ++ latest))
  end

  defp plain({:file_error, _file, {_writes, posix}}), do: posix
  defp plain({:file_error, _file, posix}), do: posix
  defp plain(reason), do: reason

  defp counted(file) do
    with {:ok, <<_::32, @cookie::32, _::binary-24, rows::32, _::binary>>} <- File.read(file),
         do: rows,
         else: (_ -> 0)
  end

  # The row of the latest change is no value. Whether it was there, only itself could say.
  defp missing(counted, rows) do
    missing = max(counted - length(rows), 0)
    if missing > 0 and not List.keymember?(rows, @latest, 0), do: :unknown, else: missing
  end

  defp damage(robot, file, copy, lost) do
    damage = %{file: file, kept_as: kept_as(file, copy), lost: lost}
    Logger.warning("#{inspect(robot)}: the parameter store #{file} #{Store.damage_words(damage)}")
    damage
  end

  defp kept_as(_file, nil), do: nil

  defp kept_as(file, copy) do
    case Disk.set_aside(copy, file <> ".corrupt") do
      {:ok, kept_as} -> kept_as
      {:error, _reason} -> nil
    end
  end
end
