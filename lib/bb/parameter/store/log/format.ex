defmodule BB.Parameter.Store.Log.Format do
  @moduledoc """
  Reads and writes the bytes of a file of `BB.Parameter.Store.Log`. Pure.

      iex> alias BB.Parameter.Store.Log.{Entry, Format}
      iex> {bytes, _contents} = Format.new(1, [Entry.encode([:gain], 1.0)], [])
      iex> {:ok, contents} = Format.read(IO.iodata_to_binary(bytes))
      iex> Enum.map(contents.entries, &Entry.decode/1)
      [ok: {[:gain], 1.0}]

  A file is made in its full size and never grows. Integers are big-endian, each `crc` is a
  CRC-32:

      header   "BBparams" version:16 0:16 size:32 generation:32 base:32 crc:32
      frame    "set!" length:32 before:32 crc:32, payload, crc:32
      …
      end      "end." before:32 crc:32 "."
      filling  the byte A5 as far as size

  `size` is the size of the file, which detects a file that was cut. `generation` counts the files
  that replaced each other. The first `base` values are the values of the previous generation, one
  in each frame. Each later frame is one change, which is saved as a whole or not at all. A
  payload is `key_size:32 data_size:32 key data` for each value. `before` counts the values in
  all frames before, so that an unreadable frame leaves a gap of known size. A checksum covers
  the place in the file too, so that a copy of a frame inside a value is no frame.

  A change is one write over the old end: its frame, and the new end. Behind an interrupted write,
  for example after a power failure, stand the old bytes. This distinguishes it from damage, and
  an interrupted write was never acknowledged. The filling differs from the zeros that a disk or
  a file system may put in the place of lost bytes.
  """

  alias BB.Parameter.Store.Log.{Contents, Entry}

  @magic "BBparams"
  @version 1
  @header_size 28
  @frame_magic "set!"
  @head_size 16
  @crc_size 4
  @end_magic "end."
  @end_size 13
  @filling <<0xA5>>
  @block 4_096
  # The free bytes of a new file, unless the file itself is large.
  @most_free 65_536

  @doc """
  Makes a new file with the values of the previous generation and a change. Returns its bytes and
  its contents.

      iex> alias BB.Parameter.Store.Log.{Entry, Format}
      iex> {bytes, _contents} =
      ...>   Format.new(7, [Entry.encode([:gain], 1.0)], [Entry.encode([:gain], 2.0)])
      iex> {:ok, contents} = Format.read(IO.iodata_to_binary(bytes))
      iex> {contents.generation, Enum.map(contents.entries, &Entry.decode/1), contents.damaged?}
      {7, [ok: {[:gain], 1.0}, ok: {[:gain], 2.0}], false}
  """
  @spec new(pos_integer(), [Entry.t()], [Entry.t()]) :: {iodata(), Contents.t()}
  def new(generation, base, change) do
    frames = Enum.map(base, &[&1]) ++ if(change == [], do: [], else: [change])
    {frames, {end_at, values}} = Enum.map_reduce(frames, {@header_size, 0}, &frame/2)
    size = size_for(end_at + @end_size)

    bytes = [
      header(size, generation, length(base)),
      frames,
      ending(end_at, values),
      :binary.copy(@filling, size - end_at - @end_size)
    ]

    contents = %Contents{generation: generation, base: length(base), values: values}
    {bytes, %{contents | size: size, end_at: end_at}}
  end

  @doc """
  Makes the bytes of a change, to be written at `contents.end_at`. Returns them and the contents
  after the write; or `:full`.
  """
  @spec append(Contents.t(), [Entry.t()]) :: {:ok, iodata(), Contents.t()} | :full
  def append(%Contents{} = contents, change) do
    {frame, {end_at, values}} = frame(change, {contents.end_at, contents.values})

    if end_at + @end_size <= contents.size,
      do: {:ok, [frame, ending(end_at, values)], %{contents | end_at: end_at, values: values}},
      else: :full
  end

  @doc "Returns the bytes at `contents.end_at` of a file that no other process has written to."
  @spec ending(Contents.t()) :: binary()
  def ending(%Contents{} = contents), do: ending(contents.end_at, contents.values)

  @doc """
  Reads the bytes of a file. For any bytes, it returns only values that `new/3` or `append/2` has
  written, and counts values that cannot be read.

  Returns `{:error, {:version, n}}` for a file of a later release of this library.
  """
  @spec read(binary()) :: {:ok, Contents.t()} | {:error, {:version, non_neg_integer()}}
  def read(bytes) do
    case read_header(bytes) do
      {:ok, contents} -> {:ok, walk(bytes, @header_size, contents)}
      {:error, {:version, _}} = error -> error
      :error -> {:ok, walk(bytes, 0, %Contents{damaged?: true})}
    end
  end

  # Writing

  defp header(size, generation, base) do
    head = <<@magic, @version::16, 0::16, size::32, generation::32, base::32>>
    <<head::binary, crc(0, head)::32>>
  end

  defp frame(entries, {at, before}) do
    payload = for entry <- entries, into: <<>>, do: encode(entry)
    head = <<@frame_magic, byte_size(payload)::32, before::32>>
    body_at = at + @head_size
    next = body_at + byte_size(payload) + @crc_size

    {[<<head::binary, crc(at, head)::32>>, payload, <<crc(body_at, payload)::32>>],
     {next, before + length(entries)}}
  end

  defp encode({key, data}),
    do: <<byte_size(key)::32, byte_size(data)::32, key::binary, data::binary>>

  # The end's last byte differs from the filling, which stands behind an interrupted write.
  defp ending(at, before) do
    head = <<@end_magic, before::32>>
    <<head::binary, crc(at, head)::32, ".">>
  end

  defp crc(at, bytes), do: :erlang.crc32(:erlang.crc32(<<at::32>>), bytes)

  # Most of a new file is free, so that few changes need another.
  defp size_for(used) do
    free = max(min(3 * used, @most_free), div(used, 2))
    div(used + free + @block - 1, @block) * @block
  end

  # Reading

  defp read_header(<<head::binary-24, crc::32, _::binary>> = bytes) do
    if crc(0, head) == crc, do: read_head(head, byte_size(bytes)), else: :error
  end

  defp read_header(_bytes), do: :error

  defp read_head(<<@magic, @version::16, _::16, size::32, generation::32, base::32>>, actual) do
    {:ok, %Contents{generation: generation, base: base, size: size, damaged?: size != actual}}
  end

  defp read_head(<<@magic, version::16, _::binary>>, _actual), do: {:error, {:version, version}}
  defp read_head(_head, _actual), do: :error

  defp walk(bytes, at, contents) do
    case part_at(bytes, at) do
      {:frame, before, entries, next} ->
        walk(bytes, next, Contents.add_frame(contents, before, entries))

      {:end, before} ->
        Contents.finish(contents, before, at)

      {:unreadable, length} ->
        skip(bytes, at, contents, @head_size + length + @crc_size)

      :nothing ->
        skip(bytes, at, contents, nil)
    end
  end

  # Skips unreadable bytes at `at`; their size is known when the head of the frame is readable.
  defp skip(bytes, at, contents, size) do
    cond do
      torn?(bytes, at, contents, size) ->
        %{Contents.finish(contents, contents.values, at) | torn?: true}

      next = next_part(bytes, at + (size || 1)) || next_part(bytes, at + 1) ->
        walk(bytes, next, %{contents | damaged?: true})

      true ->
        Contents.end_unknown(contents)
    end
  end

  defp part_at(bytes, at) when at > byte_size(bytes), do: :nothing

  defp part_at(bytes, at) do
    case bytes_from(bytes, at) do
      <<@frame_magic, length::32, before::32, crc::32, rest::binary>> ->
        head = <<@frame_magic, length::32, before::32>>
        if crc(at, head) == crc, do: frame_at(rest, at, length, before), else: :nothing

      <<@end_magic, before::32, crc::32, ".", _::binary>> ->
        if crc(at, <<@end_magic, before::32>>) == crc, do: {:end, before}, else: :nothing

      _ ->
        :nothing
    end
  end

  defp frame_at(rest, at, length, before) when byte_size(rest) >= length + @crc_size do
    payload = binary_part(rest, 0, length)
    crc = crc(at + @head_size, payload)

    with ^crc <- :binary.decode_unsigned(binary_part(rest, length, @crc_size)),
         {:ok, entries} <- entries(payload, []) do
      {:frame, before, entries, at + @head_size + length + @crc_size}
    else
      _ -> {:unreadable, length}
    end
  end

  defp frame_at(_rest, _at, length, _before), do: {:unreadable, length}

  defp entries(<<>>, entries), do: {:ok, Enum.reverse(entries)}

  defp entries(payload, entries) do
    case payload do
      <<key_size::32, data_size::32, key::binary-size(key_size), data::binary-size(data_size),
        rest::binary>> ->
        entries(rest, [{key, data} | entries])

      _ ->
        :error
    end
  end

  defp bytes_from(bytes, at), do: binary_part(bytes, at, byte_size(bytes) - at)

  # The next frame or end from `at` on.
  defp next_part(bytes, at) when at >= byte_size(bytes), do: nil

  defp next_part(bytes, at) do
    scope = {at, byte_size(bytes) - at}

    with {found, _length} <- :binary.match(bytes, [@frame_magic, @end_magic], scope: scope) do
      if part_at(bytes, found) == :nothing, do: next_part(bytes, found + 1), else: found
    else
      :nomatch -> nil
    end
  end

  defp torn?(_bytes, _at, %{damaged?: true}, _size), do: false

  defp torn?(bytes, at, contents, size) do
    tail = bytes_from(bytes, at)
    ending = ending(at, contents.values)
    torn_frame?(tail, size, ending) or torn_end?(tail, ending)
  end

  # A complete write reaches the end behind its frame.
  defp torn_frame?(tail, size, old_end) do
    written = written(tail, old_end)

    String.starts_with?(@frame_magic, binary_part(tail, 0, min(written, 4))) and
      if(size, do: written < size + @end_size, else: written <= @head_size)
  end

  # The frame before this end is complete.
  defp torn_end?(tail, ending) do
    written = binary_part(tail, 0, used(tail))
    written != "" and String.starts_with?(ending, written)
  end

  # The number of bytes that were written. Behind them stand the old end and the filling.
  defp written(tail, old_end) do
    used = used(tail)
    if used > @end_size, do: used, else: changed(tail, old_end)
  end

  # The number of bytes before the filling.
  defp used(tail), do: used(tail, byte_size(tail))

  defp used(_tail, 0), do: 0

  defp used(tail, size) do
    if binary_part(tail, size - 1, 1) == @filling, do: used(tail, size - 1), else: size
  end

  defp changed(tail, old_end) do
    differing =
      for n <- 0..(@end_size - 1),
          byte_size(tail) <= n or :binary.at(tail, n) != :binary.at(old_end, n),
          do: n + 1

    Enum.max(differing, fn -> 0 end)
  end
end
