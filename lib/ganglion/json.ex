defmodule Ganglion.Json do
  @moduledoc """
  Encodes terms as JSON text (RFC 8259).

  `bin/demo --json` and the benches use it. It accepts maps, lists, strings, atoms and numbers.
  `nil` becomes `null`; `true` and `false` stay.

      iex> Ganglion.Json.encode(%{"a" => [1, 2.5, nil], b: "x\\"y"}) |> IO.iodata_to_binary()
      ~S({"a":[1,2.5,null],"b":"x\\"y"})
  """

  @typedoc "A term that can be encoded."
  @type t ::
          nil
          | boolean()
          | number()
          | atom()
          | String.t()
          | [t()]
          | %{(atom() | String.t()) => t()}

  @doc "Returns the JSON text on one line. The keys of maps are sorted."
  @spec encode(t()) :: iodata()
  def encode(nil), do: "null"
  def encode(value) when is_boolean(value), do: Atom.to_string(value)
  def encode(value) when is_integer(value), do: Integer.to_string(value)
  def encode(value) when is_float(value), do: Float.to_string(value)
  def encode(value) when is_atom(value), do: string(Atom.to_string(value))
  def encode(value) when is_binary(value), do: string(value)

  def encode(values) when is_list(values),
    do: [?[, values |> Enum.map(&encode/1) |> Enum.intersperse(?,), ?]]

  def encode(map) when is_map(map) do
    pairs = for {key, value} <- sorted(map), do: [string(key), ?:, encode(value)]
    [?{, Enum.intersperse(pairs, ?,), ?}]
  end

  defp sorted(map),
    do:
      map
      |> Enum.map(fn {key, value} -> {to_string(key), value} end)
      |> Enum.sort_by(&elem(&1, 0))

  defp string(text), do: [?", for(<<char::utf8 <- text>>, do: escape(char)), ?"]

  defp escape(?"), do: ~S(\")
  defp escape(?\\), do: ~S(\\)
  defp escape(?\n), do: ~S(\n)

  defp escape(char) when char < 0x20,
    do: ["\\u", char |> Integer.to_string(16) |> String.pad_leading(4, "0")]

  defp escape(char), do: <<char::utf8>>
end
