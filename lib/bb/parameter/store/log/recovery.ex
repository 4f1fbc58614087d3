defmodule BB.Parameter.Store.Log.Recovery do
  @moduledoc """
  What a file of `BB.Parameter.Store.Log` and the generation before it say together. Pure.

  `entries` are the newest values that can be read, by their keys. `lost` counts those that
  cannot; it is `nil` when the file is whole. `number` is that of the newest generation.
  """

  alias BB.Parameter.Store.Log.Contents

  defstruct entries: %{}, lost: nil, number: 0

  @type t :: %__MODULE__{
          entries: %{binary() => binary()},
          lost: nil | non_neg_integer() | :unknown,
          number: non_neg_integer()
        }

  @doc "Makes the best of two files, either of which may be missing (`nil`)."
  @spec of(Contents.t() | nil, Contents.t() | nil) :: t()
  def of(%Contents{damaged?: false} = current, _before),
    do: %__MODULE__{entries: entries(current), number: current.generation}

  def of(current, before) do
    entries = Map.merge(entries(before), entries(current))
    %__MODULE__{entries: entries, lost: lost(current, before), number: number(current, before)}
  end

  defp lost(nil, _before), do: :unknown
  defp lost(%{lost: :unknown}, _before), do: :unknown

  defp lost(current, before),
    do: current.lost + if(base?(before, current), do: 0, else: current.base_lost)

  # Whether a file has all the values with which the next generation began.
  defp base?(%Contents{damaged?: false} = before, current),
    do:
      before.generation == (current.generation || 0) - 1 and
        map_size(entries(before)) == current.base

  defp base?(_before, _current), do: false

  defp entries(nil), do: %{}
  defp entries(%Contents{entries: entries}), do: Map.new(entries)

  defp number(current, before),
    do: Enum.max(for contents <- [current, before], do: (contents && contents.generation) || 0)
end
