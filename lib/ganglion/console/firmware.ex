defmodule Ganglion.Console.Firmware do
  @moduledoc """
  Collects what the console shows about the firmware, and decides whether it may be reverted.

  `Ganglion.Console.firmware/2`, `Ganglion.Console.revert/1` and the message of the day use it. It
  reads the board, the guard and the guard's folder, and prints nothing.

      Ganglion.Console.Firmware.rows(BB.Firmware.Guard, BB.Firmware.Guard.folder())
      #=> [["version", "1.0.0"], ["validation", :validated], ["guard", :done]]
  """

  alias BB.Firmware.{Board, Gate, Robots, Trial}
  alias BB.Firmware.Guard
  alias BB.Firmware.Trial.Findings
  alias Ganglion.Console.{Plain, Table}

  @doc "Returns the rows of the table: facts of the board, validation, the other slot, the guard."
  @spec rows(GenServer.server(), Path.t()) :: [[Table.cell()]]
  def rows(guard, folder) do
    board = Board.configured()
    facts = for {name, value} <- Enum.sort(Board.firmware(board)), do: [name, value]

    facts ++
      [["validation", validation(folder, board)]] ++
      other_slot_rows(folder, board) ++ guard_rows(Guard.state(guard)) ++ application_rows()
  end

  @doc "Returns the report of the last firmware that was reverted, or `nil`."
  @spec last_report(Path.t()) :: String.t() | nil
  def last_report(folder), do: Findings.read(folder, :reverted)

  @doc "Returns the version that `revert` would start, or the reason for which it is refused."
  @spec check_revert(Path.t()) :: {:ok, String.t()} | {:refused, String.t()}
  def check_revert(folder) do
    with :ok <- check_robots(Robots.state(Robots.known())),
         :ok <- check_update(Gate.busy?()),
         do: other_version(folder, Board.other(Board.configured()))
  end

  @doc "Returns the state of the guard in a few words, for the message of the day."
  @spec guard_summary() :: String.t()
  def guard_summary, do: guard_summary(Guard.state())

  defp guard_summary({:ok, %{left_ms: left_ms}}) when is_integer(left_ms),
    do: "firmware on trial, decides within #{div(left_ms, 1_000)} s"

  defp guard_summary({:ok, %{phase: :reverting}}), do: "this firmware is reverted"
  defp guard_summary({:ok, _state}), do: "this firmware stays"
  defp guard_summary({:error, :not_running}), do: "not running"

  @doc "Returns a row if Ganglion's application does not run, and no row if it does."
  @spec application_rows() :: [[String.t()]]
  def application_rows do
    if Process.whereis(Ganglion.Supervisor),
      do: [],
      else: [["application", "ganglion does not run; firmware() shows the latest events"]]
  end

  defp guard_rows({:ok, state}) do
    left = if state.left_ms, do: [["decides within", "#{div(state.left_ms, 1_000)} s"]], else: []

    reasons =
      for {check, reason} <- state.reasons,
          do: [Findings.format_check(check), Findings.format_reason(reason)]

    missing =
      for {check, words} <- state.missing,
          do: [Findings.format_check(check), "optional; " <> words]

    [["guard", state.phase]] ++ left ++ reasons ++ missing
  end

  defp guard_rows({:error, :not_running}), do: [["guard", "is not running"]]

  defp validation(folder, board) do
    case {Trial.status(folder, board), Board.validation_status(board)} do
      {:unvalidated, status} when status != :unvalidated -> "on trial, by the guard alone"
      {{:error, reason}, _board_status} -> "unknown: #{Plain.format_error(reason)}"
      {status, _board_status} -> to_string(status)
    end
  end

  defp other_slot_rows(folder, board) do
    case Board.other(board) do
      %{"nerves_fw_uuid" => uuid} = other ->
        refused = if Trial.refused?(folder, uuid), do: ", which was refused", else: ""
        [["other slot", "#{other["nerves_fw_version"]}#{refused}"]]

      _empty ->
        []
    end
  end

  defp check_robots(state) when state in [:disarmed, :error], do: :ok
  defp check_robots(state), do: {:refused, "a robot is #{state}: disarm it first"}

  defp check_update(false), do: :ok
  defp check_update(true), do: {:refused, "an update is being written"}

  defp other_version(folder, %{"nerves_fw_uuid" => uuid} = other) do
    version = other["nerves_fw_version"] || uuid

    if Trial.refused?(folder, uuid),
      do: {:refused, "the firmware #{version} in the other slot failed its trial"},
      else: {:ok, version}
  end

  defp other_version(_folder, _empty), do: {:refused, "the other slot has no firmware"}
end
