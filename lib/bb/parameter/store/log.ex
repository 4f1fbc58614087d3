defmodule BB.Parameter.Store.Log do
  @moduledoc """
  Keeps parameters in a small file that survives kills, power failures and damage; the store for a
  robot that needs no other:

      settings do
        parameter_store {BB.Parameter.Store.Log, path: "/data/params"}
      end

  A change is appended as one record with checksums and is on the disk when `BB.Parameter.set/3`
  or `set_many/2` returns, by one sync whatever the number of values. After a kill or a power
  failure at any instant it is there as a whole, or not at all.

  | beside `path` | what it is |
  |---|---|
  | `path.previous` | the generation before: the file that the present one took over from |
  | `path.corrupt`, `path.corrupt.2` to `.9` | damaged files, as they were found |
  | `path.dets` | the file of `BB.Parameter.Store.Dets` that was taken over |
  | `path.new` | the next generation, while it is written |

  A full file is replaced by a new one with the values alone, and so is that of an earlier start,
  when the first value is set.

  ## Damage

  A file that was cut, or in which a byte is wrong, is known by its checksums. It is kept as
  `path.corrupt`. Every value that can be read is used, those of the generation before take the
  place of the others, and the log and the alarm `{BB.Parameter, robot, :damaged}` say how many
  values are lost, or that nobody can know. A missing file is damage too when there is a
  generation before: to forget all parameters remove both.

  ## From DETS

  A file of `BB.Parameter.Store.Dets`, or of Beam Bots, at `path` is read and replaced. It stays
  as `path.dets`.

  ## Limits

  The file has at most 16 MiB. All values are in memory besides. Two robots cannot share a file.
  """

  @behaviour BB.Parameter.Store

  require Logger

  alias BB.Parameter.{Reason, Store}
  alias BB.Parameter.Store.{Dets, Disk}
  alias BB.Parameter.Store.Log.{Contents, Entry, Format, Recovery}

  @largest 16 * 1024 * 1024
  @previous ".previous"
  # Of values with atoms that the VM does not know. Atoms are never given back.
  @new_bytes 64 * 1024

  # `there` is what has the name `path`, and so what becomes of it when a new file takes the name.
  # The file may be appended to when `appendable?`.
  @enforce_keys [:robot, :path, :there, :entries]
  defstruct [
    :robot,
    :path,
    :there,
    :entries,
    :damage,
    number: 0,
    tail: nil,
    torn?: false,
    appendable?: false
  ]

  @typedoc "The state of a store, which is in a table."
  @type t :: %__MODULE__{
          robot: module(),
          path: Path.t(),
          there: :nothing | :whole | :damaged | :dets,
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
      # A store's callbacks return no state, so it is in a table, which ends with their process.
      table = :ets.new(__MODULE__, [:public])
      put(table, log)
      {:ok, table}
    end
  end

  @doc "The values. One that this robot cannot read is left out and stays in the file."
  @impl BB.Parameter.Store
  def load(table) do
    log = fetch(table)
    # The structs of values name these atoms.
    _ = Code.ensure_loaded(BB.Unit)
    {decoded, _budget} = Enum.map_reduce(log.entries, @new_bytes, &decode/2)
    unreadable = Enum.count(decoded, &(&1 == :error))
    if unreadable > 0, do: warn_unreadable(log, unreadable)
    {:ok, for({:ok, pair} <- decoded, do: pair)}
  end

  # The value of an `:atom` parameter may have been named in an earlier life of the robot only.
  defp decode(entry, budget) do
    size = Entry.size(entry)

    case Entry.decode(entry) do
      {:ok, pair} -> {{:ok, pair}, budget}
      :error when size > budget -> {:error, budget}
      :error -> {Entry.decode_new(entry), budget - size}
    end
  end

  @doc "Stores a value."
  @impl BB.Parameter.Store
  def save(table, path, value), do: save_many(table, [{path, value}])

  @doc "Stores values, all or none, by one sync."
  @impl BB.Parameter.Store
  def save_many(table, values) do
    log = fetch(table)

    case write(log, for({path, value} <- values, do: Entry.encode(path, value))) do
      {:ok, log} ->
        put(table, log)

      {:error, reason} ->
        # What the file has behind its last whole change is not known any more.
        put(table, %{log | appendable?: false})
        {:error, reason}
    end
  end

  @doc "What was found damaged when the file was opened, or `nil`."
  @impl BB.Parameter.Store
  def damage(table), do: fetch(table).damage

  @doc "Closes the store. Nothing waits to be written."
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
    with {:ok, log} <- look(robot, path), do: settle(log)
  end

  defp look(robot, path) do
    with {:ok, bytes} <- Disk.read(path, @largest),
         {:ok, current} <- read(bytes) do
      if foreign?(current) and Dets.file?(path),
        do: import_dets(robot, path),
        else: {:ok, recover(robot, path, current, previous(path))}
    end
  end

  defp read(nil), do: {:ok, nil}
  defp read(bytes), do: Format.read(bytes)

  # One that cannot be read is of no use, but no hindrance.
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
    do: %__MODULE__{robot: robot, path: path, there: :nothing, entries: %{}}

  defp recover(robot, path, current, before) do
    recovery = Recovery.of(current, before)

    %__MODULE__{
      robot: robot,
      path: path,
      there: there(current),
      entries: recovery.entries,
      number: recovery.number,
      torn?: match?(%{torn?: true}, current),
      damage: recovery.lost && damage(path, recovery.lost)
    }
  end

  defp there(nil), do: :nothing
  defp there(current), do: if(current.damaged?, do: :damaged, else: :whole)

  defp damage(path, lost), do: %{file: path, kept_as: nil, lost: lost}

  defp import_dets(robot, path) do
    log = %__MODULE__{robot: robot, path: path, there: :dets, entries: %{}}

    case Dets.read(path) do
      {:ok, rows, 0} ->
        {:ok, %{log | entries: entries(rows)}}

      {:ok, rows, lost} ->
        damage = damage(path, lost)
        {:ok, %{log | entries: entries(rows), there: :damaged, damage: damage}}

      # What the file system says is about the place and not the content.
      {:error, reason} when is_atom(reason) ->
        {:error, reason}

      {:error, _reason} ->
        {:ok, %{log | there: :damaged, damage: damage(path, :unknown)}}
    end
  end

  defp entries(rows), do: Map.new(rows, fn {path, value} -> Entry.encode(path, value) end)

  # The file of an earlier start stays as it is until there is something to write.
  defp settle(%{there: :whole} = log) do
    if log.torn?, do: warn_torn(log)
    {:ok, log}
  end

  defp settle(log) do
    case rewrite(log, []) do
      {:ok, new} ->
        tell(log, new)
        {:ok, new}

      {:error, reason} when log.there == :nothing and log.damage == nil ->
        {:error, reason}

      {:error, reason} ->
        tell(log, log)
        warn(log, "cannot be written anew: #{Reason.words(reason)}")
        {:ok, log}
    end
  end

  # Writing

  defp write(%{appendable?: false} = log, change), do: write_anew(log, change)

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
        warn(log, "was changed by someone else, and is written anew with the robot's own values")
        write_anew(log, change)

      {:error, reason} ->
        {:error, reason}
    end
  end

  # Whatever has the name now: nothing in it is lost, and what this robot has goes before it.
  defp write_anew(log, change) do
    with {:ok, seen} <- look(log.robot, log.path) do
      entries = Map.merge(seen.entries, log.entries)
      number = max(seen.number, log.number)
      rewrite(%{log | there: seen.there, entries: entries, number: number}, change)
    end
  end

  defp rewrite(log, change) do
    {bytes, tail} = Format.new(log.number + 1, Enum.to_list(log.entries), change)

    with :ok <- if(tail.size > @largest, do: {:error, :efbig}, else: :ok),
         :ok <- Disk.write_new(log.path, bytes),
         {:ok, kept_as} <- make_way(log),
         :ok <- Disk.replace(log.path) do
      log = %{log | tail: tail, number: tail.generation, there: :whole, appendable?: true}
      damage = if log.damage && !log.damage.kept_as, do: %{log.damage | kept_as: kept_as}
      {:ok, %{log | entries: Enum.into(change, log.entries), damage: damage || log.damage}}
    end
  end

  # A file that is missed was nobody's: it had the name a moment ago.
  defp make_way(%{there: :nothing}), do: {:ok, nil}
  defp make_way(%{there: :whole, path: path}), do: Disk.keep_as(path, path <> @previous)
  defp make_way(%{there: :damaged, path: path}), do: Disk.set_aside(path, path <> ".corrupt")
  defp make_way(%{there: :dets, path: path}), do: Disk.set_aside(path, path <> ".dets")

  # Telling

  defp tell(%{damage: nil, there: :dets} = before, _log),
    do: Logger.info("#{title(before)} took over a file of DETS, which is now #{before.path}.dets")

  defp tell(%{damage: nil}, _log), do: :ok

  defp tell(%{there: :nothing} = before, _log),
    do: warn(before, "is missing; the generation before is used, which may lack some values")

  defp tell(_before, log), do: warn(log, Store.damage_words(log.damage))

  defp warn_torn(log),
    do: warn(log, "ends in a write that was broken off; `set` had not returned for it")

  defp warn_unreadable(log, count) do
    warn(log, "has #{count} values that this robot cannot read, which stay in the file")
  end

  defp warn(log, what), do: Logger.warning("#{title(log)} #{what}")

  defp title(log), do: "#{inspect(log.robot)}: the parameter store #{log.path}"
end
