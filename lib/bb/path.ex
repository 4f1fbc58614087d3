defmodule BB.Path do
  @moduledoc """
  Where a message belongs: a list of segments from the general to the particular, as `[:sensor, :base_link, :imu]`.

  A segment is an atom; a reference is one too, for paths that nobody else may guess. A path is below each of its prefixes, and
  every path is below `[]`. Everything here is a function of its arguments.
  """

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
  def valid?([segment | rest]) when is_segment(segment), do: valid?(rest)
  def valid?([]), do: true
  def valid?(_), do: false

  @doc """
  The path itself, or an `ArgumentError` that shows what was given instead.

      iex> BB.Path.validate!([:sensor, "imu"])
      ** (ArgumentError) a path is a list of atoms (or references), got: [:sensor, "imu"]
  """
  @spec validate!(t()) :: t()
  def validate!(path) do
    if valid?(path),
      do: path,
      else:
        raise(ArgumentError, "a path is a list of atoms (or references), got: #{inspect(path)}")
  end

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
