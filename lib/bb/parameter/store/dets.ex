defmodule BB.Parameter.Store.Dets do
  @moduledoc """
  Keeps parameters in a file, by OTP's `:dets`:

      settings do
        parameter_store {BB.Parameter.Store.Dets, path: "/data/params"}
      end

  Each value is on the disk when `BB.Parameter.set/3` returns. A file that was not closed, because the power failed, is repaired
  when it is opened. One that is beyond repair is renamed to `path.corrupt`, with a warning, and an empty one takes its place:
  it never keeps the robot from starting.

  Folders above `path` are made when they are missing.
  """

  @behaviour BB.Parameter.Store

  require Logger

  @impl BB.Parameter.Store
  def init(robot, opts) do
    with {:ok, opts} <- BB.Options.validate(opts, path: [type: :string, required: true]),
         file = Path.expand(opts[:path]),
         :ok <- File.mkdir_p(Path.dirname(file)),
         do: open(robot, file)
  end

  @impl BB.Parameter.Store
  def load(table) do
    case :dets.foldl(fn row, rows -> [row | rows] end, [], table) do
      rows when is_list(rows) ->
        {:ok, for({path, value} <- rows, is_list(path), do: {path, value})}

      {:error, reason} ->
        {:error, reason}
    end
  end

  @impl BB.Parameter.Store
  def save(table, path, value) do
    with :ok <- :dets.insert(table, {path, value}), do: :dets.sync(table)
  end

  @impl BB.Parameter.Store
  def close(table), do: :dets.close(table)

  defp open(robot, file) do
    with {:error, reason} <- open_file(robot, file) do
      if File.regular?(file) and damaged?(reason),
        do: set_aside(robot, file, reason),
        else: {:error, reason}
    end
  end

  defp open_file(robot, file) do
    opts = [file: to_charlist(file), type: :set]
    with {:ok, table} <- :dets.open_file({__MODULE__, robot}, opts), do: readable(table)
  end

  # A file can be opened and yet have garbage in it, which a reader meets.
  defp readable(table) do
    case :dets.foldl(fn _row, n -> n + 1 end, 0, table) do
      n when is_integer(n) ->
        {:ok, table}

      {:error, reason} ->
        _ = :dets.close(table)
        {:error, reason}
    end
  end

  # What the file system says is an atom, such as :eacces: nothing is wrong with the file's content then.
  defp damaged?({:file_error, _file, _posix}), do: false
  defp damaged?(_reason), do: true

  defp set_aside(robot, file, reason) do
    aside = file <> ".corrupt"

    Logger.warning(
      "#{inspect(robot)}: the parameter store #{file} cannot be read (#{inspect(reason)}); it is now #{aside}, and a new one is begun"
    )

    with :ok <- File.rename(file, aside), do: open_file(robot, file)
  end
end
