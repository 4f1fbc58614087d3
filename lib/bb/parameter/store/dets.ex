defmodule BB.Parameter.Store.Dets do
  @moduledoc """
  Saves parameters in a file of OTP's `:dets`. Use it only for a robot that already has such a
  file: `BB.Parameter.Store.Log` is more reliable, and imports the file when it has the same
  `path:`.

      settings do
        parameter_store {BB.Parameter.Store.Dets, path: "/data/params"}
      end

  Values are on the disk when `BB.Parameter.set/3` or `set_many/2` returns, after two syncs. A
  file that was not closed, because the power failed, is repaired when it is opened. A file that
  cannot be repaired, or that lacks values after the repair, is kept as `path.corrupt`
  (`path.corrupt.2` to `.9` beside earlier ones), with a warning and the alarm
  `{BB.Parameter, robot, :damaged}`. It never prevents the start of the robot. Missing folders
  above `path` are made.

  DETS has no checksums, which limits its reliability:

    * After a kill in the middle of a change, the repair of DETS may restore an older row: a
      part of a `set_many/2` may be saved without the rest. This is rare.
    * A wrong byte in a value may stay unnoticed, and so may a value that is missing from a file
      that was not closed.
    * A power failure while a value is written may lose that value and the value before it.
    * No previous generation exists that could replace lost values.
  """

  @behaviour BB.Parameter.Store

  require Logger

  alias BB.Parameter.Store
  alias BB.Parameter.Store.Disk

  # The head of a DETS file has fields of 4 bytes: the second identifies the file, the ninth is
  # the number of rows.
  @cookie 0x00ABCDEF
  @copy ".import"

  # The key of the row with the latest change. A kill may have left older values in the other
  # rows.
  @latest :latest

  @options [
    path: [type: :string, required: true],
    auto_save: [type: :timeout, default: :infinity]
  ]

  @doc """
  Opens the file at `path:`, or makes it with the folders above it.

  `auto_save:` is accepted for configurations that have it. It changes nothing, because each
  change is synced. Returns `{:error, {:missing_option, :path}}` without a path, and
  `{:error, {:dets_open_failed, reason}}` when the file cannot be opened.
  """
  @impl BB.Parameter.Store
  def init(robot, opts) do
    with :ok <- check_path(opts),
         {:ok, opts} <- BB.Options.validate(opts, @options),
         do: open_file(robot, Path.expand(opts[:path]))
  end

  defp check_path(opts) do
    if Keyword.keyword?(opts) and not Keyword.has_key?(opts, :path),
      do: {:error, {:missing_option, :path}},
      else: :ok
  end

  defp open_file(robot, path) do
    with :ok <- Disk.make_folder(Path.dirname(path)), {:ok, store} <- open(robot, path) do
      {:ok, store}
    else
      {:error, reason} -> {:error, {:dets_open_failed, reason}}
    end
  end

  @doc "Returns the values, from the rows of this library and of Beam Bots."
  @impl BB.Parameter.Store
  def load(%{table: table}) do
    with {:ok, rows} <- rows(table), do: {:ok, pairs(rows)}
  end

  @doc "Saves a value."
  @impl BB.Parameter.Store
  def save(store, path, value), do: save_many(store, [{path, value}])

  @doc """
  Saves values, all or none: first in one row, then each in a row of its own.

  Returns `{:error, {:dets_write_failed, reason}}` when the file cannot be written.
  """
  @impl BB.Parameter.Store
  def save_many(%{table: table, path: file}, values) do
    with :ok <- reopen(table, file, :dets.info(table)),
         :ok <- insert(table, values) do
      :ok
    else
      {:error, reason} ->
        # After a file error, DETS refuses all writes until the table is opened again.
        _ = :dets.close(table)
        {:error, {:dets_write_failed, unwrap_reason(reason)}}
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

  @doc "Returns the damage that was found when the file was opened, or `nil`."
  @impl BB.Parameter.Store
  def damage(store), do: store.damage

  @doc "Closes the file."
  @impl BB.Parameter.Store
  def close(%{table: table}), do: :dets.close(table)

  @doc "Returns whether the file at a path is a DETS file."
  @spec file?(Path.t()) :: boolean()
  def file?(path), do: :dets.is_dets_file(to_charlist(path)) == true

  @doc """
  Returns the values in a file and the number of missing values, without changing the file. For a
  store that imports it.
  """
  @spec read(Path.t()) ::
          {:ok, [{BB.Parameter.path(), term()}], non_neg_integer() | :unknown} | {:error, term()}
  def read(path) do
    copy = path <> @copy

    with {:ok, _bytes} <- File.copy(path, copy),
         {:ok, table, rows} <- open_table(copy, copy) do
      _ = :dets.close(table)
      {:ok, pairs(rows), missing(read_row_count(path), rows)}
    else
      {:error, reason} -> {:error, unwrap_reason(reason)}
    end
  catch
    # OTP's code may fail on arbitrary bytes.
    kind, reason -> {:error, {kind, reason}}
  after
    remove_copy(path)
  end

  # Opening a damaged file changes it, so a copy is made first, unless the disk is full.
  defp open(robot, file) do
    copy =
      if File.regular?(file) and match?({:ok, _}, File.copy(file, file <> @copy)),
        do: file <> @copy

    open(robot, file, copy)
  after
    remove_copy(file)
  end

  defp open(robot, file, copy) do
    counted = read_row_count(file)

    case open_table({__MODULE__, robot}, file) do
      {:ok, table, rows} ->
        {:ok, %{table: table, path: file, damage: check(robot, file, copy, counted, rows)}}

      {:error, reason} ->
        replace_damaged(robot, file, copy, unwrap_reason(reason))
    end
  end

  defp check(robot, file, copy, counted, rows) do
    lost = missing(counted, rows)
    if lost != 0, do: damage(robot, file, copy, lost)
  end

  # A reason of the file system is an atom, such as :eacces: the content of the file is not
  # damaged.
  defp replace_damaged(_robot, _file, _copy, reason) when is_atom(reason), do: {:error, reason}

  defp replace_damaged(robot, file, copy, reason) do
    if File.regular?(file),
      do: replace(robot, file, copy || file),
      else: {:error, reason}
  end

  defp replace(robot, file, copy) do
    damage = damage(robot, file, copy, :unknown)

    with :ok <- File.rm(file),
         {:ok, table, _rows} <- open_table({__MODULE__, robot}, file) do
      {:ok, %{table: table, path: file, damage: damage}}
    else
      {:error, reason} -> {:error, unwrap_reason(reason)}
    end
  end

  defp remove_copy(file), do: File.rm(file <> @copy)

  # A file that can be opened may have garbage in it, which reading all rows finds.
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

  # The rows of Beam Bots, then ours, then the latest change: later rows override earlier ones.
  defp pairs(rows) do
    theirs = for {{:param, [_ | _] = path}, value} <- rows, do: {path, value}
    ours = for {[_ | _] = path, value} <- rows, do: {path, value}
    latest = for {@latest, values} when is_list(values) <- rows, pair <- values, do: pair
    Map.to_list(Map.new(theirs ++ ours ++ latest))
  end

  defp unwrap_reason({:file_error, _file, {_writes, posix}}), do: posix
  defp unwrap_reason({:file_error, _file, posix}), do: posix
  defp unwrap_reason(reason), do: reason

  defp read_row_count(file) do
    with {:ok, <<_::32, @cookie::32, _::binary-24, rows::32, _::binary>>} <- File.read(file),
         do: rows,
         else: (_ -> 0)
  end

  # The row of the latest change is no value, and may itself be among the missing rows.
  defp missing(counted, rows) do
    missing = max(counted - length(rows), 0)
    if missing > 0 and not List.keymember?(rows, @latest, 0), do: :unknown, else: missing
  end

  defp damage(robot, file, copy, lost) do
    damage = %{file: file, kept_as: kept_as(file, copy), lost: lost}

    Logger.warning(
      "#{inspect(robot)}: the parameter store #{file} #{Store.format_damage(damage)}"
    )

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
