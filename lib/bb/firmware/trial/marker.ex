defmodule BB.Firmware.Trial.Marker do
  @moduledoc """
  What is known of an update on its way, and what a board's start makes of it. Pure.

      accepted ── the image is in place ─► written ── another firmware runs ─► started
         │                                    │                                   │
         └─ the same firmware runs: dropped   └─ the same firmware runs:          └─ validated, or
                                                 it was reverted unseen              another runs: reverted

  Firmware is named by its id, `{uuid, slot}`: the same image can be written again, to the other
  slot. Each start of the machine has a name too (`boot`), so that looking twice in one start
  changes nothing.

  `by` says who falls back: `:board` where the board's own state is `:unvalidated`, and `:guard`
  on a board that has no such state: `BB.Firmware.Guard` tries the firmware there, and reverts it.
  Firmware that was started #{3} times there without a verdict is reverted before anything else of
  it runs.
  """

  alias BB.Firmware.Board

  @starts 3
  @attempts 3

  defstruct [:state, :boot, :from, :firmware, :version, :by, :verdict, starts: 0, notes: []]

  @typedoc "A firmware: its uuid, and its slot where that is known."
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

  @typedoc "What runs: its id and version, and what the board says of it."
  @type running :: %{id: id(), version: String.t() | nil, status: Board.status()}

  @typedoc """
  What is to be done: tell that the marker's firmware is gone (`by` whom), revert the running one,
  or give that up.
  """
  @type action :: {:reverted, t(), by :: String.t()} | {:revert, t()} | {:give_up, t()}

  @doc "What a start of the machine makes of the marker that it finds."
  @spec at_start(t() | nil, running(), boot :: String.t()) :: {t() | nil, [action()]}
  def at_start(%{boot: boot} = marker, _running, boot), do: {marker, []}

  def at_start(nil, running, boot), do: {fresh(running, boot), []}

  def at_start(%{state: :started} = marker, running, boot) do
    if same?(marker.firmware, running.id),
      do: again(%{marker | boot: boot, starts: marker.starts + 1}, running),
      else: {fresh(running, boot), [{:reverted, marker, marker.verdict || unseen(marker)}]}
  end

  def at_start(%{from: nil} = _marker, running, boot), do: {fresh(running, boot), []}

  def at_start(marker, running, boot) do
    case {same?(marker.from, running.id), marker.state} do
      {false, _state} -> {begin(marker.from, running, boot), []}
      {true, :accepted} -> {fresh(running, boot), []}
      {true, :written} -> {fresh(running, boot), [{:reverted, marker, unseen(marker)}]}
    end
  end

  # Without a marker the board's own word is all there is.
  defp fresh(%{status: :unvalidated} = running, boot), do: begin(nil, running, boot)
  defp fresh(_running, _boot), do: nil

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

  # It was validated, and the power failed before that was noted here.
  defp again(%{by: :board}, %{status: :validated}), do: {nil, []}
  defp again(%{by: :board} = marker, _running), do: {marker, []}

  defp again(%{starts: starts} = marker, running) when starts > @starts + @attempts,
    do: {fresh(running, marker.boot), [{:give_up, marker}]}

  defp again(%{starts: starts} = marker, _running) when starts > @starts do
    marker = %{marker | verdict: marker.verdict || "the board, after #{@starts} starts in vain"}
    {marker, [{:revert, marker}]}
  end

  defp again(%{verdict: nil} = marker, _running), do: {marker, []}
  defp again(marker, _running), do: {marker, [{:revert, marker}]}

  defp unseen(%{state: :started}),
    do: "the board: a power cut, its watchdog or its heart ended the trial"

  defp unseen(_written),
    do: "the board: the firmware ended before it could say that it had started"

  @doc """
  Whether two ids mean the same firmware. A slot that is not known is no difference.

      iex> BB.Firmware.Trial.Marker.same?({"u", "a"}, {"u", nil})
      true
      iex> BB.Firmware.Trial.Marker.same?({"u", "a"}, {"u", "b"})
      false
  """
  @spec same?(id() | nil, id() | nil) :: boolean()
  def same?({uuid, one}, {uuid, other}), do: one == nil or other == nil or one == other
  def same?(_one, _other), do: false

  @doc "The marker as text."
  @spec encode(t()) :: String.t()
  def encode(marker) do
    lines =
      [
        state: Atom.to_string(marker.state),
        boot: marker.boot,
        from: words(marker.from),
        firmware: words(marker.firmware),
        version: marker.version,
        by: marker.by && Atom.to_string(marker.by),
        verdict: marker.verdict,
        starts: Integer.to_string(marker.starts)
      ] ++ for(note <- marker.notes, do: {:note, note})

    for {name, value} <- lines, value not in [nil, ""], into: "", do: "#{name} #{value}\n"
  end

  defp words(nil), do: nil
  defp words({uuid, nil}), do: uuid
  defp words({uuid, slot}), do: "#{uuid} #{slot}"

  @doc "The marker of such a text. `:error` for a text that is none."
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
  defp put(["from", id], marker), do: %{marker | from: id(id)}
  defp put(["firmware", id], marker), do: %{marker | firmware: id(id)}
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

  defp id(text) do
    case String.split(text) do
      [uuid, slot] -> {uuid, slot}
      [uuid | _rest] -> {uuid, nil}
      [] -> nil
    end
  end
end
