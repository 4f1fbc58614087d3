defmodule BB.Path do
  @moduledoc """
  Where a message belongs: a list of segments from the general to the particular, as `[:sensor,
  :base_link, :imu]`.

  A segment is an atom; a reference is one too, for paths that nobody else may guess. A path is
  below each of its prefixes, and every path is below `[]`. It has at most 64 segments: each of
  them costs its publishers and subscribers a look at one more level. Everything here is a
  function of its arguments.
  """

  @max_segments 64

  @type t :: [segment()]
  @type segment :: atom() | reference()

  @doc "Whether the term can be a segment. Allowed in guards."
  defguard is_segment(segment) when is_atom(segment) or is_reference(segment)

  @doc """
  Whether the term is a path.

      iex> {BB.Path.valid?([:sensor, :imu]), BB.Path.valid?(["sensor"]), BB.Path.valid?(:sensor)}
      {true, false, false}
  """
  @spec valid?(term()) :: boolean()
  def valid?(term), do: valid?(term, @max_segments)

  defp valid?([segment | rest], left) when is_segment(segment) and left > 0,
    do: valid?(rest, left - 1)

  defp valid?([], _left), do: true
  defp valid?(_, _left), do: false

  @doc "The most segments that a path can have."
  @spec max_segments() :: pos_integer()
  def max_segments, do: @max_segments

  @doc """
  The path itself, or an `ArgumentError` that shows what was given instead.

      iex> BB.Path.validate!([:sensor, "imu"])
      ** (ArgumentError) a path is a list of atoms (or references), got: [:sensor, "imu"]

      iex> BB.Path.validate!(List.duplicate(:a, 10_000))
      ** (ArgumentError) a path has at most 64 segments, got: 10000, beginning with [:a, :a]
  """
  @spec validate!(t()) :: t()
  def validate!(path) do
    if valid?(path), do: path, else: raise(ArgumentError, complaint(path))
  end

  defp complaint(path) do
    if proper?(path) and length(path) > @max_segments,
      do:
        "a path has at most #{@max_segments} segments, got: #{length(path)}, " <>
          "beginning with #{inspect(Enum.take(path, 2))}",
      else: "a path is a list of atoms (or references), got: #{inspect(path)}"
  end

  defp proper?(path), do: is_list(path) and not List.improper?(path)

  @doc """
  Whether nobody else can have made the path: it has a reference.

      iex> {BB.Path.private?([:reply, make_ref()]), BB.Path.private?([:sensor])}
      {true, false}
  """
  @spec private?(t()) :: boolean()
  def private?(path), do: Enum.any?(path, &is_reference/1)

  @doc """
  The paths above this one, nearest first, `[]` last. There are none above `[]`.

      iex> BB.Path.ancestors([:sensor, :base_link, :imu])
      [[:sensor, :base_link], [:sensor], []]
  """
  @spec ancestors(t()) :: [t()]
  def ancestors(path), do: above(path, [], [])

  defp above([], _reversed, found), do: found

  defp above([segment | rest], reversed, found),
    do: above(rest, [segment | reversed], [Enum.reverse(reversed) | found])

  @doc """
  Whether `path` is `prefix` or below it.

      iex> {BB.Path.prefix?([:sensor], [:sensor, :imu]), BB.Path.prefix?([:sensor, :imu], [:sensor])}
      {true, false}
  """
  @spec prefix?(t(), t()) :: boolean()
  def prefix?(prefix, path), do: List.starts_with?(path, prefix)
end
