defmodule BB.Parameter.Store.Log.Contents do
  @moduledoc """
  The contents of a file of `BB.Parameter.Store.Log`. Pure. `BB.Parameter.Store.Log.Format` reads
  and appends to them.

    * `entries` - the values in the order in which they were set, after the values of the previous
      generation
    * `generation` and `base` - the number of the file, and the number of values of the previous
      generation; `nil` when the header is damaged
    * `values` - the number of values before `end_at`
    * `lost` and `base_lost` - the number of values that cannot be read, of the changes and of the
      previous generation; `:unknown` when the file has no end
    * `damaged?` - whether bytes are wrong or missing
    * `torn?` - whether the last write was interrupted
    * `size` and `end_at` - the size of the file, and the place of the next change
  """
  @moduledoc no_example: "internal: BB.Parameter.Store.Log.Format has an example"

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

  @doc "Adds a frame: its values, and the number of values before it."
  @spec add_frame(t(), non_neg_integer(), [Entry.t()]) :: t()
  def add_frame(contents, before, entries) do
    contents = add_gap(contents, before)
    newest_first = Enum.reverse(entries, contents.entries)
    %{contents | entries: newest_first, values: contents.values + length(entries)}
  end

  @doc "Ends the contents at `end_at`, after `before` values."
  @spec finish(t(), non_neg_integer(), non_neg_integer()) :: t()
  def finish(contents, before, end_at) do
    contents = add_gap(contents, before)
    %{contents | entries: Enum.reverse(contents.entries), end_at: end_at}
  end

  @doc "Ends the contents of a file without an end: the number of lost values is unknown."
  @spec end_unknown(t()) :: t()
  def end_unknown(contents) do
    contents = add_gap(contents, contents.base || 0)
    %{contents | entries: Enum.reverse(contents.entries), lost: :unknown, damaged?: true}
  end

  # A frame counts the values before it, so unreadable values leave a gap.
  defp add_gap(%{values: values} = contents, before) when before > values do
    of_base = max(min(before, contents.base || 0) - values, 0)

    %{
      contents
      | values: before,
        base_lost: contents.base_lost + of_base,
        lost: contents.lost + before - values - of_base
    }
  end

  defp add_gap(contents, _before), do: contents
end
