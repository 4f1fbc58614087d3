defmodule BB.Firmware.Story do
  @moduledoc """
  What happened to a board, a line for each event, kept over restarts: an application that ended,
  a restart of the board, an update, a revert. For a person who comes afterwards and asks why;
  `Ganglion.Console.firmware/0` shows it.

      2026-01-02T03:04:05Z the application ganglion ended (killed); it is started again (1 of 4)

  The last hundred lines are kept, in `story.txt` in the guard's folder. A line that cannot be
  kept is logged all the same.
  """

  require Logger

  alias BB.Firmware.Kept

  @first "ganglion story 1\n"
  @lines 100

  @doc "Adds a line, with the time. Never raises."
  @spec tell(Path.t(), String.t()) :: :ok | {:error, File.posix()}
  def tell(folder, text) do
    Logger.warning(text)
    # Several parts tell, and each writes all lines.
    :global.trans({{__MODULE__, folder}, self()}, fn -> add(folder, text) end, [node()])
  end

  defp add(folder, text) do
    now = DateTime.utc_now() |> DateTime.truncate(:second) |> DateTime.to_iso8601()
    lines = recent(folder, @lines - 1) ++ ["#{now} #{Kept.line(text)}"]

    with {:error, posix} <- Kept.write(file(folder), @first <> Enum.join(lines, "\n") <> "\n") do
      Logger.error("that was not kept in #{file(folder)}: #{:file.format_error(posix)}")
      {:error, posix}
    end
  end

  @doc "The last lines, the latest one last."
  @spec recent(Path.t(), pos_integer()) :: [String.t()]
  def recent(folder, count \\ @lines) do
    case Kept.read(file(folder), @first) do
      @first <> lines -> lines |> String.split("\n", trim: true) |> Enum.take(-count)
      nil -> []
    end
  end

  defp file(folder), do: Path.join(folder, "story.txt")
end
