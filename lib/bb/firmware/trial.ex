defmodule BB.Firmware.Trial do
  @moduledoc """
  Follows the trial of an update over restarts of the board. A program that writes firmware
  without `BB.Firmware.Gate` calls `accepted/3` before and `written/1` after the write:

      :ok = BB.Firmware.Trial.accepted("/data/guard", BB.Firmware.Board.configured())
      write_image()
      :ok = BB.Firmware.Trial.written("/data/guard")

  A board may revert by itself: because the guard never ran, the power failed, or the heart or the
  watchdog restarted the board. To detect this, a marker is written to the guard's folder before
  the first restart (`accepted/3`, `written/1`). The new firmware adds that it has started
  (`begin/3`), and the firmware that starts next reads the outcome from the marker. Each revert
  writes findings (`BB.Firmware.Trial.Findings`) and a line of the story (`BB.Firmware.Story`).

  A board without validation (x86_64) reports `:validated` or `:unknown` also for an update. The
  marker shows the guard that the firmware is on trial, so that it can revert it: the other
  parts of the firmware call `status/2`.

  Firmware that was reverted once is refused as the target of a later revert (`refused?/2`). If
  the board supports it, its slot is closed too.

  `BB.Firmware.Trial.Marker` decides, and this module acts. No function raises because of a
  board or a disk.
  """

  alias BB.Firmware.{Board, Kept, Story}
  alias BB.Firmware.Trial.Findings
  alias BB.Firmware.Trial.Marker

  @first "ganglion trial 1\n"
  @refused "ganglion refused 1\n"
  @refused_count 20

  @doc """
  Evaluates the marker at the start of the board. A second call in the same start changes nothing.

  Returns `{:error, reason}` when the board does not tell its firmware; it can be called again
  then.
  """
  @spec begin(Path.t(), Board.t(), boot :: String.t()) :: :ok | {:error, term()}
  def begin(folder, board, boot \\ boot()) do
    with {:ok, running} <- running(board) do
      before = read(folder)
      {marker, actions} = Marker.at_start(before, running, boot)
      _ = if marker != before, do: put_marker(folder, marker)
      Enum.each(actions, &execute(&1, folder, board, running))
    end
  end

  @doc "Records that an upload was accepted, and which firmware runs now."
  @spec accepted(Path.t(), Board.t(), boot :: String.t()) :: :ok | {:error, term()}
  def accepted(folder, board, boot \\ boot()),
    do: put_marker(folder, %Marker{state: :accepted, boot: boot, from: id(board)})

  @doc "Records that the firmware was written, and the board is about to restart."
  @spec written(Path.t()) :: :ok | {:error, term()}
  def written(folder) do
    case read(folder) do
      %Marker{state: :accepted} = marker -> put_marker(folder, %{marker | state: :written})
      _other -> :ok
    end
  end

  @doc """
  Returns the state of the running firmware: the state of the board, or `:unvalidated` for
  firmware that is on trial by the marker alone.
  """
  @spec status(Path.t(), Board.t()) :: Board.status() | {:error, term()}
  def status(folder, board) do
    status = Board.validation_status(board)

    if status in [:validated, :unknown] and on_trial_by_marker?(folder, board),
      do: :unvalidated,
      else: status
  end

  @doc "Returns whether the running firmware is on trial by the marker alone."
  @spec on_trial_by_marker?(Path.t(), Board.t()) :: boolean()
  def on_trial_by_marker?(folder, board) do
    case read(folder) do
      %Marker{state: :started, by: :guard} = marker -> Marker.same?(marker.firmware, id(board))
      _other -> false
    end
  end

  @doc "Validates the running firmware, and ends its trial."
  @spec validate(Path.t(), Board.t()) :: :ok | {:error, term()}
  def validate(folder, board) do
    with :ok <- if(on_trial_by_marker?(folder, board), do: :ok, else: Board.validate(board)),
         :ok <- Kept.remove(file(folder)) do
      remove_refused(folder, id(board))
    end
  end

  @doc """
  Records facts about the trial in the marker, a line for each, in case the trial ends without a
  verdict.
  """
  @spec put_notes(Path.t(), [String.t()]) :: :ok | {:error, term()}
  def put_notes(folder, notes),
    do: update_marker(folder, &%{&1 | notes: Enum.map(notes, fn note -> Kept.line(note) end)})

  @doc "Records which part reverts the firmware. That part also writes the findings."
  @spec put_verdict(Path.t(), by :: String.t()) :: :ok | {:error, term()}
  def put_verdict(folder, by), do: update_marker(folder, &%{&1 | verdict: Kept.line(by)})

  @doc """
  Reverts the running firmware, after it has written the findings and the story. It may never
  return.
  """
  @spec revert(Path.t(), Board.t(), by :: String.t(), [String.t()]) :: :ok | {:error, term()}
  def revert(folder, board, by, notes) do
    firmware = Board.firmware(board)
    _ = write_findings(folder, firmware, by, notes)
    _ = put_verdict(folder, by)
    version = firmware["nerves_fw_version"] || "that runs"
    _ = Story.add(folder, "the firmware #{version} is reverted by #{by}")
    Board.revert(board)
  end

  @doc "Returns whether the firmware with that uuid was on trial once and was reverted."
  @spec refused?(Path.t(), uuid :: String.t() | nil) :: boolean()
  def refused?(folder, uuid), do: uuid in refused(folder)

  @doc "Returns the id of this start of the machine."
  @spec boot() :: String.t()
  def boot do
    case File.read("/proc/sys/kernel/random/boot_id") do
      {:ok, boot} -> String.trim(boot)
      {:error, _posix} -> "vm-#{:erlang.system_info(:start_time)}"
    end
  end

  # Actions

  # The part that gave a verdict has already written the findings.
  defp execute({:reverted, %{verdict: nil} = marker, by}, folder, board, running) do
    _ = record_revert(folder, marker, by)
    close_slot(folder, board, running, marker)
  end

  defp execute({:reverted, marker, _by}, folder, board, running),
    do: close_slot(folder, board, running, marker)

  defp execute({:revert, marker}, folder, board, _running) do
    _ = record_revert(folder, marker, marker.verdict)
    Board.revert(board)
  end

  defp execute({:give_up, marker}, folder, _board, _running) do
    Story.add(folder, "#{describe(marker)} could not be reverted, and stays")
  end

  defp record_revert(folder, marker, by) do
    firmware =
      for {name, value} when value != nil <- [
            {"nerves_fw_uuid", uuid(marker.firmware)},
            {"nerves_fw_version", marker.version}
          ],
          into: %{},
          do: {name, value}

    _ =
      write_findings(folder, firmware, by, [
        "starts of it that were seen: #{marker.starts}" | marker.notes
      ])

    Story.add(folder, "#{describe(marker)} was reverted by #{by}")
  end

  defp write_findings(folder, firmware, by, notes) do
    Findings.write(folder, %{
      outcome: :reverted,
      at: DateTime.utc_now(),
      firmware: firmware,
      reasons: [],
      missing: [],
      by: by,
      notes: Enum.map(notes, &Kept.line/1)
    })
  end

  # Closes the other slot only when the running firmware stays, because it is the only one then.
  defp close_slot(folder, board, %{status: status}, marker)
       when status in [:validated, :unknown] do
    _ = add_refused(folder, uuid(marker.firmware))
    _ = spawn(fn -> Board.prevent_revert(board) end)
    :ok
  end

  defp close_slot(folder, _board, _running, marker),
    do: add_refused(folder, uuid(marker.firmware))

  defp describe(marker), do: "the firmware #{marker.version || uuid(marker.firmware)} on trial"

  defp uuid(nil), do: nil
  defp uuid({uuid, _slot}), do: uuid

  # The running firmware

  defp running(board) do
    case {id(board), Board.validation_status(board)} do
      {nil, _status} -> {:error, :unknown_firmware}
      {_id, {:error, reason}} -> {:error, reason}
      {id, status} -> {:ok, %{id: id, version: version(board), status: status}}
    end
  end

  defp id(board) do
    with uuid when is_binary(uuid) <- Board.firmware(board)["nerves_fw_uuid"],
         do: {uuid, Board.slot(board)}
  end

  defp version(board), do: Board.firmware(board)["nerves_fw_version"]

  # Files

  defp read(folder) do
    with @first <> text <- Kept.read(file(folder), @first),
         {:ok, marker} <- Marker.decode(text),
         do: marker,
         else: (_nothing -> nil)
  end

  defp update_marker(folder, fun) do
    case read(folder) do
      %Marker{state: :started} = marker -> put_marker(folder, fun.(marker))
      _other -> :ok
    end
  end

  defp put_marker(folder, nil), do: Kept.remove(file(folder))
  defp put_marker(folder, marker), do: Kept.write(file(folder), @first <> Marker.encode(marker))

  defp add_refused(_folder, nil), do: :ok

  defp add_refused(folder, uuid),
    do: put_refused(folder, Enum.take([uuid | refused(folder) -- [uuid]], @refused_count))

  # A firmware that was refused before works now.
  defp remove_refused(folder, {uuid, _slot}) do
    refused = refused(folder)
    if uuid in refused, do: put_refused(folder, refused -- [uuid]), else: :ok
  end

  defp remove_refused(_folder, nil), do: :ok

  defp refused(folder) do
    case Kept.read(refused_file(folder), @refused) do
      @refused <> uuids -> String.split(uuids)
      nil -> []
    end
  end

  defp put_refused(folder, uuids),
    do: Kept.write(refused_file(folder), @refused <> Enum.map_join(uuids, &(&1 <> "\n")))

  defp file(folder), do: Path.join(folder, "trial.txt")
  defp refused_file(folder), do: Path.join(folder, "refused.txt")
end
