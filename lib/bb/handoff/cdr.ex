defmodule BB.Handoff.Cdr do
  @moduledoc """
  Encodes and decodes CDR, the format of ROS 2 messages.

  Use it in an encoding (`BB.Handoff.Encoding`) of a ROS 2 message.

      iex> bytes = BB.Handoff.Cdr.encode([:string, :f64], ["a", 0.5])
      iex> IO.iodata_to_binary(bytes)
      <<0, 1, 0, 0, 2, 0, 0, 0, ?a, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xE0, 0x3F>>
      iex> BB.Handoff.Cdr.decode(IO.iodata_to_binary(bytes), [:string, :f64])
      {:ok, ["a", 0.5]}

  The format is little-endian plain CDR, version 1 (OMG DDS-XTypes 1.3). Every number is aligned
  to its own size, counted from the end of the encapsulation header of four bytes.

  ## Types

  A message type is described as data, in the order of its `.msg` file:

    * `:i32`, `:u32`, `:u64`, `:f32`, `:f64`, `:string`
    * `{:array, type, n}` - exactly `n` values, a list
    * `{:sequence, type}` - a count and that many values, a list
    * `[type, …]` - a structure, a list of its fields' values
    * `{:align, n}` - padding to a multiple of `n`; its value is `nil`
  """

  @header <<0, 1, 0, 0>>

  @type type ::
          :i32
          | :u32
          | :u64
          | :f32
          | :f64
          | :string
          | {:array, type(), pos_integer()}
          | {:sequence, type()}
          | {:align, pos_integer()}
          | [type()]
  @type reason ::
          :not_little_endian_cdr
          | {:truncated, offset :: non_neg_integer()}
          | {:invalid, type(), offset :: non_neg_integer()}

  @doc "Encodes `values`, which must fit `types`."
  @spec encode([type()], [term()]) :: iodata()
  def encode(types, values) do
    {body, _size} = write(types, values, {[], 0})
    [@header | Enum.reverse(body)]
  end

  @doc """
  Decodes values of `types` from the start of `data`.

  Bytes after them are ignored, as by every CDR reader. A number that is not finite is
  `{:error, {:invalid, type, offset}}`, since Erlang has no term for it.
  """
  @spec decode(binary(), [type()]) :: {:ok, [term()]} | {:error, reason()}
  def decode(@header <> body, types) do
    {values, _offset} = read(types, body, 0)
    {:ok, values}
  catch
    {__MODULE__, reason} -> {:error, reason}
  end

  def decode(_data, _types), do: {:error, :not_little_endian_cdr}

  # Writing. `out` is the chunks so far, newest first, and their size.

  defp write(types, values, out) when is_list(types) and length(types) == length(values) do
    types
    |> Enum.zip(values)
    |> Enum.reduce(out, fn {type, value}, out -> write(type, value, out) end)
  end

  defp write({:array, type, n}, values, out) when length(values) == n do
    Enum.reduce(values, out, &write(type, &1, &2))
  end

  defp write({:sequence, type}, values, out) do
    Enum.reduce(values, write(:u32, length(values), out), &write(type, &1, &2))
  end

  defp write({:align, n}, nil, out), do: align(out, n)

  defp write(:string, value, out) when is_binary(value) do
    put(write(:u32, byte_size(value) + 1, out), [value, 0], byte_size(value) + 1)
  end

  defp write(number, value, out) do
    bytes = number(number, value)
    out |> align(byte_size(bytes)) |> put(bytes, byte_size(bytes))
  end

  defp number(:i32, value), do: <<value::little-signed-32>>
  defp number(:u32, value), do: <<value::little-32>>
  defp number(:u64, value), do: <<value::little-64>>
  defp number(:f32, value), do: <<value::little-float-32>>
  defp number(:f64, value), do: <<value::little-float-64>>

  defp align({_chunks, size} = out, alignment) do
    case padding(size, alignment) do
      0 -> out
      bytes -> put(out, <<0::size(bytes)-unit(8)>>, bytes)
    end
  end

  defp put({chunks, size}, chunk, chunk_size), do: {[chunk | chunks], size + chunk_size}

  # Reading. Offsets count from the end of the header.

  defp read(types, body, offset) when is_list(types) do
    Enum.map_reduce(types, offset, &read(&1, body, &2))
  end

  defp read({:array, type, n}, body, offset), do: repeat(n, type, body, offset, [])

  defp read({:sequence, type}, body, offset) do
    {count, offset} = read(:u32, body, offset)
    repeat(count, type, body, offset, [])
  end

  defp read({:align, n}, _body, offset), do: {nil, offset + padding(offset, n)}

  defp read(:string, body, offset) do
    {size, start} = read(:u32, body, offset)
    {text(part(body, start, size, start), start), start + size}
  end

  defp read(number, body, offset) do
    size = size(number)
    start = offset + padding(offset, size)
    {parse(number, part(body, start, size, offset), start), start + size}
  end

  defp part(body, start, size, _offset) when start + size <= byte_size(body),
    do: binary_part(body, start, size)

  defp part(_body, _start, _size, offset), do: malformed({:truncated, offset})

  # A string ends with a zero byte, which its size includes.
  defp text(<<>>, _offset), do: <<>>

  defp text(bytes, offset) do
    size = byte_size(bytes) - 1

    if :binary.at(bytes, size) == 0,
      do: binary_part(bytes, 0, size),
      else: malformed({:truncated, offset})
  end

  # Every element takes at least a byte, so that a false count ends with the data.
  defp repeat(0, _type, _body, offset, values), do: {Enum.reverse(values), offset}

  defp repeat(left, type, body, offset, values) do
    {value, offset} = read(type, body, offset)
    repeat(left - 1, type, body, offset, [value | values])
  end

  defp parse(:i32, <<value::little-signed-32>>, _offset), do: value
  defp parse(:u32, <<value::little-32>>, _offset), do: value
  defp parse(:u64, <<value::little-64>>, _offset), do: value
  defp parse(:f32, <<value::little-float-32>>, _offset), do: value
  defp parse(:f64, <<value::little-float-64>>, _offset), do: value
  defp parse(type, _bytes, offset), do: malformed({:invalid, type, offset})

  defp size(type) when type in [:i32, :u32, :f32], do: 4
  defp size(type) when type in [:u64, :f64], do: 8

  defp padding(offset, alignment), do: rem(alignment - rem(offset, alignment), alignment)

  @spec malformed(reason()) :: no_return()
  defp malformed(reason), do: throw({__MODULE__, reason})
end
