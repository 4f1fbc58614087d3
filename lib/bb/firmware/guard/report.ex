defmodule BB.Firmware.Guard.Report do
  @moduledoc """
  What a guard leaves behind for a person: why a firmware was reverted, and what was missing in one that was validated.

  A report is text in the guard's folder, `reverted.txt` or `validated.txt`: the last one of each kind. It is written beside its
  place, forced to the disk and renamed, so that a power failure leaves the old one or the new one. A file that is no report is
  renamed to `….corrupt`, logged, and counts as missing.
  """

  require Logger

  alias BB.Firmware.Guard.Decision

  @first "ganglion guard report 1\n"

  @type outcome :: :validated | :reverted
  @type t :: %{
          outcome: outcome(),
          at: DateTime.t(),
          firmware: %{String.t() => String.t()},
          reasons: [{Decision.check(), Decision.reason()}],
          missing: [{Decision.check(), String.t()}]
        }

  @doc "Writes a report into the folder, which is made if need be."
  @spec write(Path.t(), t()) :: :ok | {:error, File.posix()}
  def write(folder, report) do
    file = file(folder, report.outcome)

    with :ok <- File.mkdir_p(folder),
         :ok <- write_synced(file <> ".new", text(report)),
         do: File.rename(file <> ".new", file)
  end

  @doc "The last report of that outcome, as text; `nil` when there is none."
  @spec read(Path.t(), outcome()) :: String.t() | nil
  def read(folder, outcome) do
    file = file(folder, outcome)

    case File.read(file) do
      {:ok, @first <> _ = text} -> if String.valid?(text), do: text, else: set_aside(file)
      {:ok, _other} -> set_aside(file)
      {:error, _posix} -> nil
    end
  end

  @doc "A report as it is written."
  @spec text(t()) :: String.t()
  def text(report) do
    IO.iodata_to_binary([
      @first,
      "#{report.outcome} at #{DateTime.to_iso8601(report.at)}\n",
      for({name, value} <- Enum.sort(report.firmware), do: "#{name} #{value}\n"),
      for({check, reason} <- report.reasons, do: "required: #{name(check)}: #{words(reason)}\n"),
      for({check, words} <- report.missing, do: "optional: #{name(check)}: #{words}\n")
    ])
  end

  @doc """
  A check's name.

      iex> BB.Firmware.Guard.Report.name({:sensor, :imu})
      "sensor imu"
  """
  @spec name(Decision.check()) :: String.t()
  def name({kind, name}), do: "#{kind} #{name}"
  def name(name), do: to_string(name)

  @doc """
  A reason in words.

      iex> BB.Firmware.Guard.Report.words({:good_for, 900, 2, {:silent, 1200}})
      "good for 900 ms only; broke 2 times, last: said nothing for 1200 ms"
  """
  @spec words(Decision.reason() | nil) :: String.t()
  def words(nil), do: "good"
  def words(:never), do: "was never good"
  def words({:silent, ms}), do: "said nothing for #{ms} ms"
  def words({:bad, text}) when is_binary(text), do: text
  def words({:bad, reason}), do: inspect(reason)
  def words({:good_for, ms, 0, _reason}), do: "good for #{ms} ms only"

  def words({:good_for, ms, breaks, reason}),
    do: "good for #{ms} ms only; broke #{breaks} times, last: #{words(reason)}"

  defp write_synced(file, text) do
    with {:ok, result} <- File.open(file, [:write, :raw], &write_and_sync(&1, text)), do: result
  end

  defp write_and_sync(device, text) do
    with :ok <- :file.write(device, text), do: :file.sync(device)
  end

  defp set_aside(file) do
    Logger.warning("#{file} is no report of a guard; it is now #{file}.corrupt")
    _ = File.rename(file, file <> ".corrupt")
    nil
  end

  defp file(folder, outcome), do: Path.join(folder, "#{outcome}.txt")
end
