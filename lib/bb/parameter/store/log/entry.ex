defmodule BB.Parameter.Store.Log.Entry do
  @moduledoc """
  A value as `BB.Parameter.Store.Log` writes it: `{key, data}`, the path and the value as bytes of
  their own. Pure.

  The store keeps and copies bytes. A value that this robot cannot read, because an update removed
  what it names, therefore stays in the file for the robot that can.
  """

  @type t :: {key :: binary(), data :: binary()}

  @compressed 80

  @doc """
  The bytes of a path and its value.

      iex> alias BB.Parameter.Store.Log.Entry
      iex> [:imu, :rate] |> Entry.encode(100.0) |> Entry.decode()
      {:ok, {[:imu, :rate], 100.0}}
  """
  @spec encode(BB.Parameter.path(), term()) :: t()
  def encode(path, value), do: {encode_term(path), encode_term(value)}

  @doc """
  The path and the value; `:error` for bytes that are no term, or name an atom that this VM does
  not know.
  """
  @spec decode(t()) :: {:ok, {BB.Parameter.path(), term()}} | :error
  def decode(entry), do: decode(entry, [:safe])

  @doc """
  As `decode/1`, but new atoms are made. They are never given back, so the caller bounds the
  bytes.
  """
  @spec decode_new(t()) :: {:ok, {BB.Parameter.path(), term()}} | :error
  def decode_new(entry), do: decode(entry, [])

  @doc "How many bytes it has."
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

  # A compressed term can be far larger than its bytes, and none is ever written.
  defp decode_term(<<131, @compressed, _::binary>>, _opts), do: :error

  defp decode_term(bytes, opts) do
    {:ok, :erlang.binary_to_term(bytes, opts)}
  rescue
    ArgumentError -> :error
  end
end
