defmodule BB.Parameter.Store.Log do
  @moduledoc """
  Saves parameters in a small file that survives kills, power failures and damage. Use it unless a
  robot needs another store:

      settings do
        parameter_store {BB.Parameter.Store.Log, path: "/data/params"}
      end

  A change is appended as one record with checksums. It is on the disk when `BB.Parameter.set/3`
  or `set_many/2` returns, after one sync for any number of values. After a kill or a power
  failure at any instant the whole change is saved, or nothing of it.

  | file beside `path` | content |
  |---|---|
  | `path.previous` | the previous generation: the file that the present file has replaced |
  | `path.corrupt`, `path.corrupt.2` to `.9` | damaged files, unchanged |
  | `path.dets` | the imported file of `BB.Parameter.Store.Dets` |
  | `path.new` | the next generation, while it is written |

  A new file with the values alone replaces a full file. It also replaces the file of an earlier
  start, when the first value is set.

  ## Damage

  Checksums detect a file that was cut or has a wrong byte. Such a file is kept as `path.corrupt`.
  Every value that can be read is used, and the values of the previous generation replace the
  others. The log and the alarm `{BB.Parameter, robot, :damaged}` have the number of lost
  values, or say that it is unknown. A missing file is damage too when a previous generation
  exists: remove both to reset all parameters.

  ## From DETS

  A file of `BB.Parameter.Store.Dets`, or of Beam Bots, at `path` is imported and replaced. The
  old file stays as `path.dets`.

  ## Limits

  The file has at most 16 MiB, and all values are in memory too. Two robots cannot share a file.
  """

  @behaviour BB.Parameter.Store

  require Logger

  alias BB.Parameter.{Reason, Store}
  alias BB.Parameter.Store.{Dets, Disk}
  alias BB.Parameter.Store.Log.{Contents, Entry, Format, Recovery}

  @largest 16 * 1024 * 1024
  @previous ".previous"
  # The bytes of values with new atoms. The VM never frees atoms.
  @new_bytes 64 * 1024

  # `present` is the kind of the file at `path`, which decides its new name when a new file
  # replaces it. Changes may be appended to the file when `appendable?`.
  @enforce_keys [:robot, :path, :present, :entries]
  defstruct [
    :robot,
    :path,
    :present,
    :entries,
    :damage,
    number: 0,
    tail: nil,
    torn?: false,
    appendable?: false
  ]

  @typedoc "The state of a store, which an ETS table holds."
  @type t :: %__MODULE__{
          robot: module(),
          path: Path.t(),
          present: :nothing | :whole | :damaged | :dets,
          entries: %{binary() => binary()},
          damage: Store.damage() | nil,
          number: non_neg_integer(),
          tail: Contents.t() | nil,
          torn?: boolean(),
          appendable?: boolean()
        }

  @doc "Opens the file at `path:`, or makes it with the folders above it."
  @impl BB.Parameter.Store
  def init(robot, opts) do
    with {:ok, opts} <- BB.Options.validate(opts, path: [type: :string, required: true]),
         path = Disk.resolve(opts[:path]),
         :ok <- Disk.make_folder(Path.dirname(path)),
         {:ok, log} <- open(robot, path) do
      # The callbacks of a store return no state, so a table of their process has it.
      table = :ets.new(__MODULE__, [:public])
      put(table, log)
      {:ok, table}
    end
  end

  @doc """
  Returns the values. A value that this robot cannot read is left out, and stays in the file.
  """
  @impl BB.Parameter.Store
  def load(table) do
    log = fetch(table)
    # Loads the atoms of the structs in values.
    _ = Code.ensure_loaded(BB.Unit)
    {decoded, _budget} = Enum.map_reduce(log.entries, @new_bytes, &decode/2)
    unreadable = Enum.count(decoded, &(&1 == :error))
    if unreadable > 0, do: warn_unreadable(log, unreadable)
    {:ok, for({:ok, pair} <- decoded, do: pair)}
  end

  # The VM may not know the atom in the value of an `:atom` parameter.
  defp decode(entry, budget) do
    size = Entry.size(entry)

    case Entry.decode(entry) do
      {:ok, pair} -> {{:ok, pair}, budget}
      :error when size > budget -> {:error, budget}
      :error -> {Entry.decode_new(entry), budget - size}
    end
  end

  @doc "Saves a value."
  @impl BB.Parameter.Store
  def save(table, path, value), do: save_many(table, [{path, value}])

  @doc "Saves values, all or none, with one sync."
  @impl BB.Parameter.Store
  def save_many(table, values) do
    log = fetch(table)

    case write(log, for({path, value} <- values, do: Entry.encode(path, value))) do
      {:ok, log} ->
        put(table, log)

      {:error, reason} ->
        # The bytes behind the last whole change are unknown now.
        put(table, %{log | appendable?: false})
        {:error, reason}
    end
  end

  @doc "Returns the damage that was found when the file was opened, or `nil`."
  @impl BB.Parameter.Store
  def damage(table), do: fetch(table).damage

  @doc "Closes the store. No value waits to be written."
  @impl BB.Parameter.Store
  def close(table) do
    :ets.delete(table)
    :ok
  end

  defp fetch(table), do: :ets.lookup_element(table, :log, 2)

  defp put(table, log) do
    :ets.insert(table, {:log, log})
    :ok
  end

  # Opening

  defp open(robot, path) do
    with {:ok, log} <- read_state(robot, path), do: replace_if_needed(log)
  end

  defp read_state(robot, path) do
    with {:ok, bytes} <- Disk.read(path, @largest),
         {:ok, current} <- read(bytes) do
      if foreign?(current) and Dets.file?(path),
        do: import_dets(robot, path),
        else: {:ok, recover(robot, path, current, previous(path))}
    end
  end

  defp read(nil), do: {:ok, nil}
  defp read(bytes), do: Format.read(bytes)

  # A previous generation that cannot be read is ignored.
  defp previous(path) do
    with {:ok, bytes} <- Disk.read(path <> @previous, @largest),
         {:ok, before} <- read(bytes) do
      before
    else
      {:error, _reason} -> nil
    end
  end

  defp foreign?(current), do: match?(%{generation: nil, entries: []}, current)

  defp recover(robot, path, nil, nil),
    do: %__MODULE__{robot: robot, path: path, present: :nothing, entries: %{}}

  defp recover(robot, path, current, before) do
    recovery = Recovery.of(current, before)

    %__MODULE__{
      robot: robot,
      path: path,
      present: kind(current),
      entries: recovery.entries,
      number: recovery.number,
      torn?: match?(%{torn?: true}, current),
      damage: recovery.lost && damage(path, recovery.lost)
    }
  end

  defp kind(nil), do: :nothing
  defp kind(current), do: if(current.damaged?, do: :damaged, else: :whole)

  defp damage(path, lost), do: %{file: path, kept_as: nil, lost: lost}

  defp import_dets(robot, path) do
    log = %__MODULE__{robot: robot, path: path, present: :dets, entries: %{}}

    case Dets.read(path) do
      {:ok, rows, 0} ->
        {:ok, %{log | entries: entries(rows)}}

      {:ok, rows, lost} ->
        damage = damage(path, lost)
        {:ok, %{log | entries: entries(rows), present: :damaged, damage: damage}}

      # A reason of the file system is an atom: the content of the file is not damaged.
      {:error, reason} when is_atom(reason) ->
        {:error, reason}

      {:error, _reason} ->
        {:ok, %{log | present: :damaged, damage: damage(path, :unknown)}}
    end
  end

  defp entries(rows), do: Map.new(rows, fn {path, value} -> Entry.encode(path, value) end)

  # A whole file of an earlier start stays unchanged until the first write.
  defp replace_if_needed(%{present: :whole} = log) do
    if log.torn?, do: warn_torn(log)
    {:ok, log}
  end

  defp replace_if_needed(log) do
    case rewrite(log, []) do
      {:ok, new} ->
        log_result(log, new)
        {:ok, new}

      {:error, reason} when log.present == :nothing and log.damage == nil ->
        {:error, reason}

      {:error, reason} ->
        log_result(log, log)
        warn(log, "cannot be rewritten: #{Reason.format(reason)}")
        {:ok, log}
    end
  end

  # Writing

  defp write(%{appendable?: false} = log, change), do: merge_and_rewrite(log, change)

  defp write(log, change) do
    case Format.append(log.tail, change) do
      {:ok, bytes, tail} -> append(log, change, bytes, tail)
      :full -> rewrite(log, change)
    end
  end

  defp append(%{tail: before} = log, change, bytes, tail) do
    case Disk.overwrite(log.path, before.end_at, Format.ending(before), bytes) do
      :ok ->
        {:ok, %{log | tail: tail, entries: Enum.into(change, log.entries)}}

      :changed ->
        warn(log, "was changed by another process, and is rewritten with the robot's own values")
        merge_and_rewrite(log, change)

      {:error, reason} ->
        {:error, reason}
    end
  end

  # Keeps the values of the file that has the name now; the values of this robot override them.
  defp merge_and_rewrite(log, change) do
    with {:ok, seen} <- read_state(log.robot, log.path) do
      entries = Map.merge(seen.entries, log.entries)
      number = max(seen.number, log.number)
      rewrite(%{log | present: seen.present, entries: entries, number: number}, change)
    end
  end

  defp rewrite(log, change) do
    {bytes, tail} = Format.new(log.number + 1, Enum.to_list(log.entries), change)

    with :ok <- if(tail.size > @largest, do: {:error, :efbig}, else: :ok),
         :ok <- Disk.write_new(log.path, bytes),
         {:ok, kept_as} <- keep_present(log),
         :ok <- Disk.replace(log.path) do
      log = %{log | tail: tail, number: tail.generation, present: :whole, appendable?: true}
      damage = if log.damage && !log.damage.kept_as, do: %{log.damage | kept_as: kept_as}
      {:ok, %{log | entries: Enum.into(change, log.entries), damage: damage || log.damage}}
    end
  end

  # Gives the file at `path` another name, before a new file replaces it.
  defp keep_present(%{present: :nothing}), do: {:ok, nil}
  defp keep_present(%{present: :whole, path: path}), do: Disk.keep_as(path, path <> @previous)

  defp keep_present(%{present: :damaged, path: path}),
    do: Disk.set_aside(path, path <> ".corrupt")

  defp keep_present(%{present: :dets, path: path}), do: Disk.set_aside(path, path <> ".dets")

  # Log lines

  defp log_result(%{damage: nil, present: :dets} = before, _log),
    do:
      Logger.info(
        "#{title(before)} imported a DETS file, which is renamed to #{before.path}.dets"
      )

  defp log_result(%{damage: nil}, _log), do: :ok

  defp log_result(%{present: :nothing} = before, _log),
    do: warn(before, "is missing; the previous generation is used, which may lack some values")

  defp log_result(_before, log), do: warn(log, Store.format_damage(log.damage))

  defp warn_torn(log),
    do: warn(log, "ends in an interrupted write; `set` had not returned for it")

  defp warn_unreadable(log, count) do
    warn(log, "has #{count} values that this robot cannot read, which stay in the file")
  end

  defp warn(log, text), do: Logger.warning("#{title(log)} #{text}")

  defp title(log), do: "#{inspect(log.robot)}: the parameter store #{log.path}"
end
