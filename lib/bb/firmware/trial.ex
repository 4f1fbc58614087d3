defmodule BB.Firmware.Trial do
  @moduledoc """
  The trial of an update, over restarts: who is on trial, and what became of those before.

  A board that goes back to its old firmware by itself - the guard never ran, the power failed,
  heart or watchdog restarted the board - tells nobody. So a marker is written to the guard's
  folder before the first restart (`accepted/3`, `written/1`), the new firmware writes into it
  that it has started (`begin/3`), and whichever firmware starts next sees from it what happened.
  Each revert leaves a report (`BB.Firmware.Trial.Findings`) and a line of the story
  (`BB.Firmware.Story`), whoever made it.

  A board without a fallback of its own (x86_64) says `:validated` or `:unknown` of an update too.
  With a marker the guard knows that it is on trial all the same, and reverts it if need be:
  `status/2` is what the rest of the firmware asks.

  What was reverted once is refused as a firmware to go back to (`refused?/2`); where the board
  can, its slot is closed too.

  `BB.Firmware.Trial.Marker` decides, this module acts. Nothing here raises for what a board or a
  disk does.
  """

  alias BB.Firmware.{Board, Kept, Story}
  alias BB.Firmware.Trial.Findings
  alias BB.Firmware.Trial.Marker

  @first "ganglion trial 1\n"
  @refused "ganglion refused 1\n"
  @refused_count 20

  @doc """
  Looks at the marker at the start of the machine. Called twice in one start it changes nothing
  the second time.

  `{:error, reason}` when the board does not say what runs; then it can be called again.
  """
  @spec begin(Path.t(), Board.t(), boot :: String.t()) :: :ok | {:error, term()}
  def begin(folder, board, boot \\ boot()) do
    with {:ok, running} <- running(board) do
      before = read(folder)
      {marker, actions} = Marker.at_start(before, running, boot)
      _ = if marker != before, do: keep(folder, marker)
      Enum.each(actions, &act(&1, folder, board, running))
    end
  end

  @doc "An upload was let in: what runs now is the firmware that an update would leave."
  @spec accepted(Path.t(), Board.t(), boot :: String.t()) :: :ok | {:error, term()}
  def accepted(folder, board, boot \\ boot()),
    do: keep(folder, %Marker{state: :accepted, boot: boot, from: id(board)})

  @doc "The image is in place, and the board is about to restart with it."
  @spec written(Path.t()) :: :ok | {:error, term()}
  def written(folder) do
    case read(folder) do
      %Marker{state: :accepted} = marker -> keep(folder, %{marker | state: :written})
      _other -> :ok
    end
  end

  @doc """
  The state of the running firmware: the board's own, and `:unvalidated` also for firmware that
  the guard tries, because the board has no such state.
  """
  @spec status(Path.t(), Board.t()) :: Board.status() | {:error, term()}
  def status(folder, board) do
    status = Board.validation_status(board)
    if status in [:validated, :unknown] and tried?(folder, board), do: :unvalidated, else: status
  end

  @doc "Whether the running firmware is on trial by the guard alone."
  @spec tried?(Path.t(), Board.t()) :: boolean()
  def tried?(folder, board) do
    case read(folder) do
      %Marker{state: :started, by: :guard} = marker -> Marker.same?(marker.firmware, id(board))
      _other -> false
    end
  end

  @doc "The firmware works: it stays."
  @spec validate(Path.t(), Board.t()) :: :ok | {:error, term()}
  def validate(folder, board) do
    with :ok <- if(tried?(folder, board), do: :ok, else: Board.validate(board)),
         :ok <- Kept.remove(file(folder)) do
      allow(folder, id(board))
    end
  end

  @doc """
  What is known of the trial until now, a line for each thing, for the case that nobody can tell
  later.
  """
  @spec note(Path.t(), [String.t()]) :: :ok | {:error, term()}
  def note(folder, notes),
    do: change(folder, &%{&1 | notes: Enum.map(notes, fn note -> Kept.line(note) end)})

  @doc "Who has reverted the firmware. The report of it is written by the same."
  @spec verdict(Path.t(), by :: String.t()) :: :ok | {:error, term()}
  def verdict(folder, by), do: change(folder, &%{&1 | verdict: Kept.line(by)})

  @doc """
  Reverts the running firmware, after who does it and why were told. It may never return.
  """
  @spec revert(Path.t(), Board.t(), by :: String.t(), [String.t()]) :: :ok | {:error, term()}
  def revert(folder, board, by, notes) do
    firmware = Board.firmware(board)
    _ = report(folder, firmware, by, notes)
    _ = verdict(folder, by)
    version = firmware["nerves_fw_version"] || "that runs"
    _ = Story.tell(folder, "the firmware #{version} is reverted by #{by}")
    Board.revert(board)
  end

  @doc "Whether the firmware of that uuid was on trial once, and did not stay."
  @spec refused?(Path.t(), uuid :: String.t() | nil) :: boolean()
  def refused?(folder, uuid), do: uuid in refused(folder)

  @doc "The name of this start of the machine."
  @spec boot() :: String.t()
  def boot do
    case File.read("/proc/sys/kernel/random/boot_id") do
      {:ok, boot} -> String.trim(boot)
      {:error, _posix} -> "vm-#{:erlang.system_info(:start_time)}"
    end
  end

  # What is done

  # The report of who gave a verdict is there already.
  defp act({:reverted, %{verdict: nil} = marker, by}, folder, board, running) do
    _ = tell(folder, marker, by)
    close(folder, board, running, marker)
  end

  defp act({:reverted, marker, _by}, folder, board, running),
    do: close(folder, board, running, marker)

  defp act({:revert, marker}, folder, board, _running) do
    _ = tell(folder, marker, marker.verdict)
    Board.revert(board)
  end

  defp act({:give_up, marker}, folder, _board, _running) do
    Story.tell(folder, "#{named(marker)} could not be reverted, and stays")
  end

  defp tell(folder, marker, by) do
    firmware =
      for {name, value} when value != nil <- [
            {"nerves_fw_uuid", uuid(marker.firmware)},
            {"nerves_fw_version", marker.version}
          ],
          into: %{},
          do: {name, value}

    _ =
      report(folder, firmware, by, [
        "starts of it that were seen: #{marker.starts}" | marker.notes
      ])

    Story.tell(folder, "#{named(marker)} was reverted by #{by}")
  end

  defp report(folder, firmware, by, notes) do
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

  # Only once the running firmware is known to stay, for it is the only one then.
  defp close(folder, board, %{status: status}, marker) when status in [:validated, :unknown] do
    _ = refuse(folder, uuid(marker.firmware))
    _ = spawn(fn -> Board.prevent_revert(board) end)
    :ok
  end

  defp close(folder, _board, _running, marker), do: refuse(folder, uuid(marker.firmware))

  defp named(marker), do: "the firmware #{marker.version || uuid(marker.firmware)} on trial"

  defp uuid(nil), do: nil
  defp uuid({uuid, _slot}), do: uuid

  # What runs

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

  # What is kept

  defp read(folder) do
    with @first <> text <- Kept.read(file(folder), @first),
         {:ok, marker} <- Marker.decode(text),
         do: marker,
         else: (_nothing -> nil)
  end

  defp change(folder, fun) do
    case read(folder) do
      %Marker{state: :started} = marker -> keep(folder, fun.(marker))
      _other -> :ok
    end
  end

  defp keep(folder, nil), do: Kept.remove(file(folder))
  defp keep(folder, marker), do: Kept.write(file(folder), @first <> Marker.encode(marker))

  defp refuse(_folder, nil), do: :ok

  defp refuse(folder, uuid),
    do: keep_refused(folder, Enum.take([uuid | refused(folder) -- [uuid]], @refused_count))

  # It was refused, came again, and works now.
  defp allow(folder, {uuid, _slot}) do
    refused = refused(folder)
    if uuid in refused, do: keep_refused(folder, refused -- [uuid]), else: :ok
  end

  defp allow(_folder, nil), do: :ok

  defp refused(folder) do
    case Kept.read(refused_file(folder), @refused) do
      @refused <> uuids -> String.split(uuids)
      nil -> []
    end
  end

  defp keep_refused(folder, uuids),
    do: Kept.write(refused_file(folder), @refused <> Enum.map_join(uuids, &(&1 <> "\n")))

  defp file(folder), do: Path.join(folder, "trial.txt")
  defp refused_file(folder), do: Path.join(folder, "refused.txt")
end
