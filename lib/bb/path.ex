defmodule BB.Path do
  @moduledoc """
  A path on the pubsub: a list of segments from the general to the particular.

  Use these functions to check paths and to compare them. `BB.PubSub` delivers a message published
  at a path to the subscribers at that path and at its ancestors:

      iex> BB.Path.ancestors([:sensor, :base_link, :imu])
      [[:sensor, :base_link], [:sensor], []]
      iex> BB.Path.prefix?([:sensor], [:sensor, :base_link, :imu])
      true

  A segment is an atom, or a reference in paths that no other process may guess. A path is below
  each of its prefixes, and every path is below `[]`. It has at most 64 segments, because
  publishers and subscribers look at each level. All functions are pure.
  """

  @max_segments 64

  @type t :: [segment()]
  @type segment :: atom() | reference()

  @doc "Returns whether the term can be a segment. Allowed in guards."
  defguard is_segment(segment) when is_atom(segment) or is_reference(segment)

  @doc """
  Returns whether the term is a path.

      iex> {BB.Path.valid?([:sensor, :imu]), BB.Path.valid?(["sensor"]), BB.Path.valid?(:sensor)}
      {true, false, false}
  """
  @spec valid?(term()) :: boolean()
  def valid?(term), do: valid?(term, @max_segments)

  defp valid?([segment | rest], left) when is_segment(segment) and left > 0,
    do: valid?(rest, left - 1)

  defp valid?([], _left), do: true
  defp valid?(_, _left), do: false

  @doc "Returns the largest number of segments that a path can have."
  @spec max_segments() :: pos_integer()
  def max_segments, do: @max_segments

  @doc """
  Returns the path. Raises `ArgumentError` if it is not a valid one.

      iex> BB.Path.validate!([:sensor, "imu"])
      ** (ArgumentError) expected a path, a list of atoms (or references), got: [:sensor, "imu"]

      iex> BB.Path.validate!(List.duplicate(:a, 10_000))
      ** (ArgumentError) expected a path of at most 64 segments, got: 10000 in [:a, :a | ...]
  """
  @spec validate!(t()) :: t()
  def validate!(path) do
    if valid?(path), do: path, else: raise(ArgumentError, error_message(path))
  end

  defp error_message(path) do
    if proper?(path) and length(path) > @max_segments,
      do:
        "expected a path of at most #{@max_segments} segments, got: #{length(path)} in " <>
          "[#{path |> Enum.take(2) |> Enum.map_join(", ", &inspect/1)} | ...]",
      else: "expected a path, a list of atoms (or references), got: #{inspect(path)}"
  end

  defp proper?(path), do: is_list(path) and not List.improper?(path)

  @doc """
  Returns whether the path is private: it contains a reference, which no other process can guess.

      iex> {BB.Path.private?([:reply, make_ref()]), BB.Path.private?([:sensor])}
      {true, false}
  """
  @spec private?(t()) :: boolean()
  def private?(path), do: Enum.any?(path, &is_reference/1)

  @doc """
  Returns the paths above this one, from the nearest to `[]`. The path `[]` has none.

      iex> BB.Path.ancestors([:sensor, :base_link, :imu])
      [[:sensor, :base_link], [:sensor], []]
  """
  @spec ancestors(t()) :: [t()]
  def ancestors(path), do: above(path, [], [])

  defp above([], _reversed, found), do: found

  defp above([segment | rest], reversed, found),
    do: above(rest, [segment | reversed], [Enum.reverse(reversed) | found])

  @doc """
  Returns whether `path` is `prefix` or below it.

      iex> BB.Path.prefix?([:sensor], [:sensor, :imu])
      true
      iex> BB.Path.prefix?([:sensor, :imu], [:sensor])
      false
  """
  @spec prefix?(t(), t()) :: boolean()
  def prefix?(prefix, path), do: List.starts_with?(path, prefix)
end
