defmodule BB.Firmware.Kept do
  @moduledoc """
  Small text files that survive a power failure. The parts of the firmware use them to remember
  facts over restarts.

      BB.Firmware.Kept.write("/data/guard/restarts.txt", "ganglion restarts 1\n3\n")
      BB.Firmware.Kept.read("/data/guard/restarts.txt", "ganglion restarts 1\n")

  A file is written under another name, synced and renamed, so that a power failure leaves the old
  text or the new one. Each kind of file begins with a line of its own. A file with another first
  line, or that is no text, is renamed to `….corrupt`, logged, and counts as missing.

  The functions never raise: a folder that cannot be written to is `{:error, posix}`.
  """

  require Logger

  @doc "Writes `text`, which begins with the line of its kind, and replaces the file."
  @spec write(Path.t(), String.t()) :: :ok | {:error, File.posix()}
  def write(file, text) do
    with :ok <- File.mkdir_p(Path.dirname(file)),
         :ok <- write_synced(file <> ".new", text),
         do: File.rename(file <> ".new", file)
  end

  @doc "Returns the text of a file whose first line is `first`, or `nil`."
  @spec read(Path.t(), first :: String.t()) :: String.t() | nil
  def read(file, first) do
    with {:ok, text} <- File.read(file) do
      if String.starts_with?(text, first) and String.valid?(text), do: text, else: set_aside(file)
    else
      {:error, _posix} -> nil
    end
  end

  @doc "Removes a file. Returns `:ok` also when the file does not exist."
  @spec remove(Path.t()) :: :ok | {:error, File.posix()}
  def remove(file) do
    with {:error, reason} when reason not in [:enoent, :enotdir] <- File.rm(file),
         do: {:error, reason},
         else: (_gone -> :ok)
  end

  @doc "Formats a term as one line of text."
  @spec line(term()) :: String.t()
  def line(text) when is_binary(text) do
    if String.valid?(text),
      do: text |> String.replace(~r/\s+/u, " ") |> String.slice(0, 300),
      else: line(inspect(text, limit: 50))
  end

  def line(term), do: line(inspect(term, limit: 20, printable_limit: 200))

  defp write_synced(file, text) do
    with {:ok, result} <- File.open(file, [:write, :raw], &write_and_sync(&1, text)), do: result
  end

  defp write_and_sync(device, text) do
    with :ok <- :file.write(device, text), do: :file.sync(device)
  end

  defp set_aside(file) do
    Logger.warning("the file #{file} has no format of this firmware; renamed to #{file}.corrupt")
    _ = File.rename(file, file <> ".corrupt")
    nil
  end
end
