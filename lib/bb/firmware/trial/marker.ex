defmodule BB.Firmware.Trial.Marker do
  @moduledoc """
  The marker of an update on trial, and the decision at each start of the board. Pure.
  `BB.Firmware.Trial` reads and writes it.

      accepted ── firmware written ─► written ── another firmware runs ─► started
         │                               │                                   │
         └─ same firmware runs:          └─ same firmware runs:              └─ validated, or
            dropped                         reverted unseen                     another one runs:
                                                                                reverted

  The id of a firmware is `{uuid, slot}`, because the same image can be written to the other slot.
  Each start of the machine has an id too (`boot`), so that a second call in one start changes
  nothing.

  `by` is the part that reverts: `:board` when the board itself reports `:unvalidated`, and
  `:guard` on a board without validation, where `BB.Firmware.Guard` tries the firmware and
  reverts it. There, firmware that was started three times without a verdict is reverted before
  it runs.
  """
  @moduledoc no_example: "internal: BB.Firmware.Trial is its interface"

  alias BB.Firmware.Board

  @starts 3
  @attempts 3

  defstruct [:state, :boot, :from, :firmware, :version, :by, :verdict, starts: 0, notes: []]

  @typedoc "A firmware: its uuid, and its slot or `nil`."
  @type id :: {uuid :: String.t(), slot :: String.t() | nil}

  @type t :: %__MODULE__{
          state: :accepted | :written | :started,
          boot: String.t(),
          from: id() | nil,
          firmware: id() | nil,
          version: String.t() | nil,
          by: :board | :guard | nil,
          verdict: String.t() | nil,
          starts: non_neg_integer(),
          notes: [String.t()]
        }

  @typedoc "The running firmware: its id and version, and the board's state of it."
  @type running :: %{id: id(), version: String.t() | nil, status: Board.status()}

  @typedoc """
  An action: report that the marker's firmware was reverted, revert the running firmware, or
  give up the revert.
  """
  @type action :: {:reverted, t(), by :: String.t()} | {:revert, t()} | {:give_up, t()}

  @doc """
  Decides at a start of the machine, from the marker: returns the new marker and the actions.
  """
  @spec at_start(t() | nil, running(), boot :: String.t()) :: {t() | nil, [action()]}
  def at_start(%{boot: boot} = marker, _running, boot), do: {marker, []}

  def at_start(nil, running, boot), do: {new_marker(running, boot), []}

  def at_start(%{state: :started} = marker, running, boot) do
    if same?(marker.firmware, running.id),
      do: count_start(%{marker | boot: boot, starts: marker.starts + 1}, running),
      else:
        {new_marker(running, boot),
         [{:reverted, marker, marker.verdict || describe_unseen(marker)}]}
  end

  def at_start(%{from: nil} = _marker, running, boot), do: {new_marker(running, boot), []}

  def at_start(marker, running, boot) do
    case {same?(marker.from, running.id), marker.state} do
      {false, _state} ->
        {begin(marker.from, running, boot), []}

      {true, :accepted} ->
        {new_marker(running, boot), []}

      {true, :written} ->
        {new_marker(running, boot), [{:reverted, marker, describe_unseen(marker)}]}
    end
  end

  # Without a marker the state of the board counts.
  defp new_marker(%{status: :unvalidated} = running, boot), do: begin(nil, running, boot)
  defp new_marker(_running, _boot), do: nil

  defp begin(from, running, boot) do
    %__MODULE__{
      state: :started,
      boot: boot,
      from: from,
      firmware: running.id,
      version: running.version,
      by: if(running.status == :unvalidated, do: :board, else: :guard),
      starts: 1
    }
  end

  # The power failed after the validation, before the marker was removed.
  defp count_start(%{by: :board}, %{status: :validated}), do: {nil, []}
  defp count_start(%{by: :board} = marker, _running), do: {marker, []}

  defp count_start(%{starts: starts} = marker, running) when starts > @starts + @attempts,
    do: {new_marker(running, marker.boot), [{:give_up, marker}]}

  defp count_start(%{starts: starts} = marker, _running) when starts > @starts do
    marker = %{marker | verdict: marker.verdict || "the board, after #{@starts} starts in vain"}
    {marker, [{:revert, marker}]}
  end

  defp count_start(%{verdict: nil} = marker, _running), do: {marker, []}
  defp count_start(marker, _running), do: {marker, [{:revert, marker}]}

  defp describe_unseen(%{state: :started}),
    do: "the board: a power cut, its watchdog or its heart ended the trial"

  defp describe_unseen(_written),
    do: "the board: the firmware ended before it could say that it had started"

  @doc """
  Returns whether two ids mean the same firmware. An unknown slot matches any slot.

      iex> BB.Firmware.Trial.Marker.same?({"u", "a"}, {"u", nil})
      true
      iex> BB.Firmware.Trial.Marker.same?({"u", "a"}, {"u", "b"})
      false
  """
  @spec same?(id() | nil, id() | nil) :: boolean()
  def same?({uuid, one}, {uuid, other}), do: one == nil or other == nil or one == other
  def same?(_one, _other), do: false

  @doc "Encodes the marker as text."
  @spec encode(t()) :: String.t()
  def encode(marker) do
    lines =
      [
        state: Atom.to_string(marker.state),
        boot: marker.boot,
        from: format_id(marker.from),
        firmware: format_id(marker.firmware),
        version: marker.version,
        by: marker.by && Atom.to_string(marker.by),
        verdict: marker.verdict,
        starts: Integer.to_string(marker.starts)
      ] ++ for(note <- marker.notes, do: {:note, note})

    for {name, value} <- lines, value not in [nil, ""], into: "", do: "#{name} #{value}\n"
  end

  defp format_id(nil), do: nil
  defp format_id({uuid, nil}), do: uuid
  defp format_id({uuid, slot}), do: "#{uuid} #{slot}"

  @doc "Decodes a marker. Returns `:error` for any other text."
  @spec decode(String.t()) :: {:ok, t()} | :error
  def decode(text) do
    marker =
      for line <- String.split(text, "\n", trim: true), reduce: %__MODULE__{boot: ""} do
        marker -> line |> String.split(" ", parts: 2) |> put(marker)
      end

    if valid?(marker), do: {:ok, %{marker | notes: Enum.reverse(marker.notes)}}, else: :error
  end

  defp valid?(%{state: :started, firmware: firmware, by: by}), do: firmware != nil and by != nil
  defp valid?(marker), do: marker.state != nil

  defp put(["state", state], marker) when state in ~w(accepted written started),
    do: %{marker | state: String.to_existing_atom(state)}

  defp put(["by", by], marker) when by in ~w(board guard),
    do: %{marker | by: String.to_existing_atom(by)}

  defp put(["boot", boot], marker), do: %{marker | boot: boot}
  defp put(["from", id], marker), do: %{marker | from: parse_id(id)}
  defp put(["firmware", id], marker), do: %{marker | firmware: parse_id(id)}
  defp put(["version", version], marker), do: %{marker | version: version}
  defp put(["verdict", verdict], marker), do: %{marker | verdict: verdict}
  defp put(["note", note], marker), do: %{marker | notes: [note | marker.notes]}

  defp put(["starts", starts], marker) do
    case Integer.parse(starts) do
      {starts, ""} when starts >= 0 -> %{marker | starts: starts}
      _other -> marker
    end
  end

  defp put(_unknown, marker), do: marker

  defp parse_id(text) do
    case String.split(text) do
      [uuid, slot] -> {uuid, slot}
      [uuid | _rest] -> {uuid, nil}
      [] -> nil
    end
  end
end
