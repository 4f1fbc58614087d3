defmodule BB.Firmware.Trial.Findings do
  @moduledoc """
  The findings of a trial, as a text for people: why and by whom a firmware was reverted, and
  which sensors were missing in one that was validated. `BB.Firmware.Guard` and
  `BB.Firmware.Trial` write them, `Ganglion.Console.firmware/0` shows them.

  The text is in the guard's folder, in `reverted.txt` or `validated.txt`, which have the last
  findings of each kind. A power failure does not damage them (`BB.Firmware.Kept`).

      iex> findings = %{outcome: :validated, at: ~U[2026-01-02 03:04:05Z], firmware: %{},
      ...>   reasons: [], missing: []}
      iex> BB.Firmware.Trial.Findings.text(findings)
      "ganglion guard report 1\\nvalidated at 2026-01-02T03:04:05Z\\n"
  """

  alias BB.Firmware.Guard.Validation
  alias BB.Firmware.Kept

  @first "ganglion guard report 1\n"

  @type outcome :: :validated | :reverted

  @typedoc """
  The findings. `by` names the part that reverted, `notes` are other known facts; both are
  optional.
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

  @doc "Writes findings into the folder, which is made if it is missing."
  @spec write(Path.t(), t()) :: :ok | {:error, File.posix()}
  def write(folder, findings), do: Kept.write(file(folder, findings.outcome), text(findings))

  @doc "Returns the text of the last findings with that outcome, or `nil`."
  @spec read(Path.t(), outcome()) :: String.t() | nil
  def read(folder, outcome), do: Kept.read(file(folder, outcome), @first)

  @doc "Formats findings as text."
  @spec text(t()) :: String.t()
  def text(findings) do
    IO.iodata_to_binary([
      @first,
      "#{findings.outcome} at #{DateTime.to_iso8601(findings.at)}\n",
      for(by <- List.wrap(findings[:by]), do: "by #{by}\n"),
      for({name, value} <- Enum.sort(findings.firmware), do: "#{name} #{value}\n"),
      for(
        {check, reason} <- findings.reasons,
        do: "required: #{format_check(check)}: #{format_reason(reason)}\n"
      ),
      for({check, words} <- findings.missing, do: "optional: #{format_check(check)}: #{words}\n"),
      for(note <- Map.get(findings, :notes, []), do: "note: #{note}\n")
    ])
  end

  @doc """
  Formats the name of a check.

      iex> BB.Firmware.Trial.Findings.format_check({:sensor, :imu})
      "sensor imu"
  """
  @spec format_check(Validation.check()) :: String.t()
  def format_check({kind, name}), do: "#{kind} #{name}"
  def format_check(name), do: to_string(name)

  @doc """
  Formats a reason.

      iex> BB.Firmware.Trial.Findings.format_reason({:good_for, 900, 2, {:silent, 1200}})
      "good for 900 ms only; broke 2 times, last: silent for 1200 ms"
  """
  @spec format_reason(Validation.reason() | nil) :: String.t()
  def format_reason(nil), do: "good"
  def format_reason(:never), do: "was never good"
  def format_reason({:silent, ms}), do: "silent for #{ms} ms"
  def format_reason({:bad, text}) when is_binary(text), do: text
  def format_reason({:bad, reason}), do: inspect(reason)
  def format_reason({:good_for, ms, 0, _reason}), do: "good for #{ms} ms only"

  def format_reason({:good_for, ms, breaks, reason}),
    do: "good for #{ms} ms only; broke #{breaks} times, last: #{format_reason(reason)}"

  defp file(folder, outcome), do: Path.join(folder, "#{outcome}.txt")
end
