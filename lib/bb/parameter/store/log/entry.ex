defmodule BB.Parameter.Store.Log.Entry do
  @moduledoc """
  Encodes and decodes a value of `BB.Parameter.Store.Log` as `{key, data}`, the bytes of the path
  and the bytes of the value. Pure.

      iex> alias BB.Parameter.Store.Log.Entry
      iex> [:imu, :rate] |> Entry.encode(100.0) |> Entry.decode()
      {:ok, {[:imu, :rate], 100.0}}

  The store copies bytes and not terms. So a value that this robot cannot read, because an update
  removed a module, stays in the file for a robot that can read it.
  """

  @type t :: {key :: binary(), data :: binary()}

  @compressed 80

  @doc """
  Encodes a path and its value.
  """
  @spec encode(BB.Parameter.path(), term()) :: t()
  def encode(path, value), do: {encode_term(path), encode_term(value)}

  @doc """
  Decodes the path and the value. Returns `:error` for bytes that are no term, or that name an
  atom which this VM does not know.
  """
  @spec decode(t()) :: {:ok, {BB.Parameter.path(), term()}} | :error
  def decode(entry), do: decode(entry, [:safe])

  @doc """
  Decodes like `decode/1`, and makes new atoms. The VM never frees atoms, so the caller bounds the
  bytes.
  """
  @spec decode_new(t()) :: {:ok, {BB.Parameter.path(), term()}} | :error
  def decode_new(entry), do: decode(entry, [])

  @doc "Returns the number of bytes of an entry."
  @spec size(t()) :: non_neg_integer()
  def size({key, data}), do: byte_size(key) + byte_size(data)

  defp decode({key, data}, opts) do
    with {:ok, [_ | _] = path} <- decode_term(key, opts),
         {:ok, value} <- decode_term(data, opts) do
      {:ok, {path, value}}
    else
      _ -> :error
    end
  end

  # Equal paths have equal bytes.
  defp encode_term(term), do: :erlang.term_to_binary(term, minor_version: 2)

  # A compressed term can be far larger than its bytes, and the store writes none.
  defp decode_term(<<131, @compressed, _::binary>>, _opts), do: :error

  defp decode_term(bytes, opts) do
    {:ok, :erlang.binary_to_term(bytes, opts)}
  rescue
    ArgumentError -> :error
  end
end
