defmodule BB.Parameter.Store.Log.Recovery do
  @moduledoc """
  Recovers the values of a file of `BB.Parameter.Store.Log` from its contents and those of the
  previous generation. Pure.

  `entries` are the newest values that can be read, by their keys. `lost` counts the values that
  cannot be read; it is `nil` when the file is whole. `number` is the number of the newest
  generation.
  """
  @moduledoc no_example: "internal: BB.Parameter.Store.Log opens files with it"

  alias BB.Parameter.Store.Log.Contents

  defstruct entries: %{}, lost: nil, number: 0

  @type t :: %__MODULE__{
          entries: %{binary() => binary()},
          lost: nil | non_neg_integer() | :unknown,
          number: non_neg_integer()
        }

  @doc "Recovers values from two files, either of which may be missing (`nil`)."
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
    do: current.lost + if(complete_base?(before, current), do: 0, else: current.base_lost)

  # Whether the previous file has all values with which the next generation began.
  defp complete_base?(%Contents{damaged?: false} = before, current),
    do:
      before.generation == (current.generation || 0) - 1 and
        map_size(entries(before)) == current.base

  defp complete_base?(_before, _current), do: false

  defp entries(nil), do: %{}
  defp entries(%Contents{entries: entries}), do: Map.new(entries)

  defp number(current, before),
    do: Enum.max(for contents <- [current, before], do: (contents && contents.generation) || 0)
end
