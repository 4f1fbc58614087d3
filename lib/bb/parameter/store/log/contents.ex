defmodule BB.Parameter.Store.Log.Contents do
  @moduledoc """
  What stands in a file of `BB.Parameter.Store.Log`, as `BB.Parameter.Store.Log.Format.read/1`
  found it. Pure.

    * `entries` - the values in the order in which they were set, those of the generation before
      first
    * `generation` and `base` - the file's number, and how many values the generation before had;
      `nil` when the header is damaged
    * `values` - how many values stand before the place that `end_at` names
    * `lost` and `base_lost` - how many values cannot be read, of the changes and of the
      generation before; `:unknown` when the file has no end
    * `damaged?` - whether bytes are wrong or missing
    * `torn?` - whether the last write was broken off
    * `size` and `end_at` - the file's size, and where the next change goes
  """

  alias BB.Parameter.Store.Log.Entry

  defstruct entries: [],
            generation: nil,
            base: nil,
            values: 0,
            lost: 0,
            base_lost: 0,
            damaged?: false,
            torn?: false,
            size: 0,
            end_at: 0

  @type t :: %__MODULE__{
          entries: [Entry.t()],
          generation: non_neg_integer() | nil,
          base: non_neg_integer() | nil,
          values: non_neg_integer(),
          lost: non_neg_integer() | :unknown,
          base_lost: non_neg_integer(),
          damaged?: boolean(),
          torn?: boolean(),
          size: non_neg_integer(),
          end_at: non_neg_integer()
        }

  @doc "Adds a frame: the values in it, and the number of values that stand before it."
  @spec take(t(), non_neg_integer(), [Entry.t()]) :: t()
  def take(contents, before, entries) do
    contents = miss(contents, before)
    newest_first = Enum.reverse(entries, contents.entries)
    %{contents | entries: newest_first, values: contents.values + length(entries)}
  end

  @doc "The file ends here, after `before` values."
  @spec finish(t(), non_neg_integer(), non_neg_integer()) :: t()
  def finish(contents, before, end_at) do
    contents = miss(contents, before)
    %{contents | entries: Enum.reverse(contents.entries), end_at: end_at}
  end

  @doc "The file breaks off: nobody knows what stood in the rest."
  @spec break_off(t()) :: t()
  def break_off(contents) do
    contents = miss(contents, contents.base || 0)
    %{contents | entries: Enum.reverse(contents.entries), lost: :unknown, damaged?: true}
  end

  # Frames count what stands before them, so what could not be read is a gap.
  defp miss(%{values: values} = contents, before) when before > values do
    of_base = max(min(before, contents.base || 0) - values, 0)

    %{
      contents
      | values: before,
        base_lost: contents.base_lost + of_base,
        lost: contents.lost + before - values - of_base
    }
  end

  defp miss(contents, _before), do: contents
end
