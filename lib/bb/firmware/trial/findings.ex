defmodule BB.Firmware.Trial.Findings do
  @moduledoc """
  What is left behind for a person: why a firmware was reverted and by whom, and what was missing
  in one that was validated.

  A report is text in the guard's folder, `reverted.txt` or `validated.txt`: the last one of each
  kind, which a power failure does not damage (`BB.Firmware.Kept`).
  """

  alias BB.Firmware.Guard.Validation
  alias BB.Firmware.Kept

  @first "ganglion guard report 1\n"

  @type outcome :: :validated | :reverted

  @typedoc """
  `by` says who reverted (`nil` when nobody did), `notes` what else is known; both may be left out.
  """
  @type t :: %{
          required(:outcome) => outcome(),
          required(:at) => DateTime.t(),
          required(:firmware) => %{String.t() => String.t()},
          required(:reasons) => [{Validation.check(), Validation.reason()}],
          required(:missing) => [{Validation.check(), String.t()}],
          optional(:by) => String.t() | nil,
          optional(:notes) => [String.t()]
        }

  @doc "Writes a report into the folder, which is made if need be."
  @spec write(Path.t(), t()) :: :ok | {:error, File.posix()}
  def write(folder, report), do: Kept.write(file(folder, report.outcome), text(report))

  @doc "The last report of that outcome, as text; `nil` when there is none."
  @spec read(Path.t(), outcome()) :: String.t() | nil
  def read(folder, outcome), do: Kept.read(file(folder, outcome), @first)

  @doc "A report as it is written."
  @spec text(t()) :: String.t()
  def text(report) do
    IO.iodata_to_binary([
      @first,
      "#{report.outcome} at #{DateTime.to_iso8601(report.at)}\n",
      for(by <- List.wrap(report[:by]), do: "by #{by}\n"),
      for({name, value} <- Enum.sort(report.firmware), do: "#{name} #{value}\n"),
      for({check, reason} <- report.reasons, do: "required: #{name(check)}: #{words(reason)}\n"),
      for({check, words} <- report.missing, do: "optional: #{name(check)}: #{words}\n"),
      for(note <- Map.get(report, :notes, []), do: "note: #{note}\n")
    ])
  end

  @doc """
  A check's name.

      iex> BB.Firmware.Trial.Findings.name({:sensor, :imu})
      "sensor imu"
  """
  @spec name(Validation.check()) :: String.t()
  def name({kind, name}), do: "#{kind} #{name}"
  def name(name), do: to_string(name)

  @doc """
  A reason in words.

      iex> BB.Firmware.Trial.Findings.words({:good_for, 900, 2, {:silent, 1200}})
      "good for 900 ms only; broke 2 times, last: said nothing for 1200 ms"
  """
  @spec words(Validation.reason() | nil) :: String.t()
  def words(nil), do: "good"
  def words(:never), do: "was never good"
  def words({:silent, ms}), do: "said nothing for #{ms} ms"
  def words({:bad, text}) when is_binary(text), do: text
  def words({:bad, reason}), do: inspect(reason)
  def words({:good_for, ms, 0, _reason}), do: "good for #{ms} ms only"

  def words({:good_for, ms, breaks, reason}),
    do: "good for #{ms} ms only; broke #{breaks} times, last: #{words(reason)}"

  defp file(folder, outcome), do: Path.join(folder, "#{outcome}.txt")
end
