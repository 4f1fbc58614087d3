defmodule BB.Firmware.Story do
  @moduledoc """
  The story of a board, a line for each event, which survives restarts: an application that
  ended, a restart of the board, an update, a revert. `Ganglion.Console.firmware/0` shows it to
  people who look for a cause.

      2026-01-02T03:04:05Z the application ganglion ended (killed); start 1 of 4 follows

  The file `story.txt` in the guard's folder has the last hundred lines. A line that cannot be
  written is logged all the same.
  """

  require Logger

  alias BB.Firmware.Kept

  @first "ganglion story 1\n"
  @lines 100

  @doc "Logs a line and adds it to the story, with the time. Never raises."
  @spec add(Path.t(), String.t()) :: :ok | {:error, File.posix()}
  def add(folder, text) do
    Logger.warning(text)
    # Several processes add lines, and each writes the whole file.
    :global.trans({{__MODULE__, folder}, self()}, fn -> append(folder, text) end, [node()])
  end

  defp append(folder, text) do
    now = DateTime.utc_now() |> DateTime.truncate(:second) |> DateTime.to_iso8601()
    lines = recent(folder, @lines - 1) ++ ["#{now} #{Kept.line(text)}"]

    with {:error, posix} <- Kept.write(file(folder), @first <> Enum.join(lines, "\n") <> "\n") do
      Logger.error("could not write the story #{file(folder)}: #{:file.format_error(posix)}")
      {:error, posix}
    end
  end

  @doc "Returns the last lines, the latest one last."
  @spec recent(Path.t(), pos_integer()) :: [String.t()]
  def recent(folder, count \\ @lines) do
    case Kept.read(file(folder), @first) do
      @first <> lines -> lines |> String.split("\n", trim: true) |> Enum.take(-count)
      nil -> []
    end
  end

  defp file(folder), do: Path.join(folder, "story.txt")
end
