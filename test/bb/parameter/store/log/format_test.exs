defmodule BB.Parameter.Store.Log.FormatTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Parameter.Store.Log.{Contents, Entry, Format}

  @moduletag timeout: 300_000

  doctest Format

  # A file as it is in use: the base of a generation, the change it was made for, and some changes
  # appended to it.
  defp file(base, first, changes) do
    {bytes, contents} = Format.new(3, base, first)
    Enum.reduce(changes, {IO.iodata_to_binary(bytes), contents}, &append/2)
  end

  defp append(change, {bytes, contents}) do
    {:ok, write, after_it} = Format.append(contents, change)
    {put(bytes, contents.end_at, IO.iodata_to_binary(write)), after_it}
  end

  defp put(bytes, at, new) do
    after_it = at + byte_size(new)

    [binary_part(bytes, 0, at), new, binary_part(bytes, after_it, byte_size(bytes) - after_it)]
    |> IO.iodata_to_binary()
  end

  defp entry(name, value), do: Entry.encode([name], value)

  @base [{"a", "1"}, {"b", "2"}, {"c", "3"}]
  @first [{"a", "4"}]
  @changes [[{"b", "5"}, {"c", "6"}], [{"d", "7"}], [{"e", "8"}, {"a", "9"}]]

  defp read!(bytes) do
    assert {:ok, contents} = Format.read(bytes)
    contents
  end

  defp all, do: List.flatten([@base, @first | @changes])

  test "a whole file is read in the order in which its values were set" do
    {bytes, tail} = file(@base, @first, @changes)
    contents = read!(bytes)
    assert contents.entries == all()
    assert {contents.generation, contents.base, contents.values} == {3, 3, 9}
    assert {contents.lost, contents.base_lost} == {0, 0}
    refute contents.damaged? or contents.torn?
    assert {contents.end_at, contents.size} == {tail.end_at, byte_size(bytes)}
  end

  test "a file has the room of blocks, most of it free, and says when it is full" do
    {bytes, contents} = Format.new(1, [], [])
    assert IO.iodata_length(bytes) == 4_096
    value = String.duplicate("v", 1_000)
    assert {:ok, _, contents} = Format.append(contents, [{"k", value}])
    assert {:ok, _, contents} = Format.append(contents, [{"k", value}])
    assert {:ok, _, contents} = Format.append(contents, [{"k", value}])
    assert Format.append(contents, [{"k", value}]) == :full
    {bytes, _} = Format.new(2, [{"k", String.duplicate("v", 5_000)}], [])
    assert IO.iodata_length(bytes) == 20_480
  end

  test "a file of a later release is an error and not damage, if its checksum is right" do
    {<<magic::binary-8, _version::16, rest::binary-14, _::binary>>, _} = file([], [], [])
    head = <<magic::binary, 2::16, rest::binary>>
    sum = :erlang.crc32(:erlang.crc32(<<0::32>>), head)
    assert Format.read(<<head::binary, sum::32>>) == {:error, {:version, 2}}
    assert {:ok, %Contents{damaged?: true}} = Format.read(<<head::binary, sum + 1::32>>)
  end

  describe "damage" do
    # What is returned was set, in that order; and if anything is missing, the contents says so,
    # and how much.
    defp assert_honest(contents, what) do
      assert subsequence?(contents.entries, all()), "#{what}: #{inspect(contents)}"
      missing = length(all()) - length(contents.entries)
      said = if contents.lost == :unknown, do: :unknown, else: contents.lost + contents.base_lost

      if missing > 0 do
        assert contents.damaged?, "#{what}: #{missing} are missing, and nothing is said"
        assert said in [:unknown, missing], "#{what}: #{missing} are missing, #{said} are said"
      end
    end

    defp subsequence?([], _all), do: true
    defp subsequence?(_some, []), do: false
    defp subsequence?([same | some], [same | all]), do: subsequence?(some, all)
    defp subsequence?(some, [_other | all]), do: subsequence?(some, all)

    test "by a cut at any byte is told, and what stood before is read" do
      {bytes, _} = file(@base, @first, @changes)

      for size <- 0..(byte_size(bytes) - 1) do
        contents = read!(binary_part(bytes, 0, size))
        assert contents.damaged?, "a cut after #{size} bytes"
        assert_honest(contents, "a cut after #{size} bytes")
      end
    end

    for {what, byte} <- [{"zeros", 0x00}, {"what erased memory holds", 0xFF}] do
      test "by #{what} from any byte on is told, and is no write that was broken off" do
        {bytes, tail} = file(@base, @first, @changes)

        for at <- 0..(tail.end_at - 1) do
          lost = :binary.copy(<<unquote(byte)>>, byte_size(bytes) - at)
          contents = read!(binary_part(bytes, 0, at) <> lost)
          assert contents.damaged?, "from #{at} on"
          assert_honest(contents, "from #{at} on")
        end
      end
    end

    test "of any byte, whatever it becomes, is no wrong value and nothing missing untold" do
      {bytes, _} = file(@base, @first, @changes)

      for at <- 0..(byte_size(bytes) - 1), pattern <- [0x01, 0x80, 0x55, 0xFF, :zero, ?!, ?.] do
        flipped = put(bytes, at, <<flip(:binary.at(bytes, at), pattern)>>)
        assert_honest(read!(flipped), "byte #{at} by #{inspect(pattern)}")
      end
    end

    defp flip(_byte, :zero), do: 0
    defp flip(byte, pattern), do: Bitwise.bxor(byte, pattern)

    test "of one value leaves all others, before it and behind it, and is counted" do
      {bytes, _} = file(@base, @first, @changes)

      for {key, value} <- all(), {at, _} <- :binary.matches(bytes, key <> value) do
        contents = read!(put(bytes, at, "!"))
        assert contents.lost + contents.base_lost == length(all()) - length(contents.entries)
        assert (contents.lost + contents.base_lost) in 1..2
      end
    end

    test "is told from values in which bytes of the file stand" do
      {bytes, %{end_at: end_at}} = file(@base, @first, @changes)
      inner = binary_part(bytes, 0, end_at + 20)
      {outer, _} = file([{"x", inner}], [{"y", inner}], [])

      for at <- 0..200 do
        contents = read!(put(outer, at, <<Bitwise.bxor(:binary.at(outer, at), 0x10)>>))
        assert subsequence?(contents.entries, [{"x", inner}, {"y", inner}])
      end
    end

    property "of any bytes is read", numtests: 300 do
      forall {bytes, prefix} <- {binary(), integer(0, 300)} do
        {whole, _} = file(@base, @first, @changes)
        assert {:ok, _} = Format.read(bytes)
        assert {:ok, _} = Format.read(binary_part(whole, 0, prefix) <> bytes)
        true
      end
    end
  end

  describe "a write that was broken off" do
    test "at any byte is no damage, and its change is not there in part" do
      {before, contents} = file(@base, @first, @changes)
      change = [{"f", String.duplicate("long", 20)}, {"g", ""}]
      {:ok, write, _} = Format.append(contents, change)
      write = IO.iodata_to_binary(write)

      for size <- 0..byte_size(write) do
        torn = read!(put(before, contents.end_at, binary_part(write, 0, size)))
        assert torn.entries in [all(), all() ++ change]
        assert torn.entries == all() or size >= byte_size(write) - 13
        # Exactly between the frame and the end it looks as if the rest had been lost.
        assert torn.damaged? == (size == byte_size(write) - 13), "broken off after #{size} bytes"
      end
    end

    test "is no damage either when it went over blocks, or its last blocks came first" do
      {before, contents} = file(@base, @first, [[{"f", :binary.copy(<<0xA5>>, 50)}]])
      {:ok, write, _} = Format.append(contents, [{"g", :binary.copy(<<0x5A>>, 3_000)}])
      write = IO.iodata_to_binary(write)
      whole = put(before, contents.end_at, write)
      entries = read!(before).entries

      for block <- 512..(byte_size(before) - 512)//512 do
        first = binary_part(whole, 0, block) <> binary_part(before, block, 4_096 - block)
        last = binary_part(before, 0, block) <> binary_part(whole, block, 4_096 - block)

        for torn <- [first, last] do
          contents = read!(torn)
          refute contents.damaged?
          assert contents.entries in [entries, read!(whole).entries]
        end
      end
    end

    test "of values that end as the filling does is not accepted without its end" do
      {before, contents} = file(@base, @first, [])

      {:ok, write, _} =
        Format.append(contents, [{"z", :binary.copy(<<:binary.last(before)>>, 100)}])

      write = IO.iodata_to_binary(write)

      for size <- 1..(byte_size(write) - 14) do
        torn = read!(put(before, contents.end_at, binary_part(write, 0, size)))
        assert torn.entries == @base ++ @first
      end
    end
  end

  property "files of any values are read as they were written" do
    forall {base, changes} <- {list({atom(), any()}), list(non_empty(list({atom(), any()})))} do
      encode = fn pairs -> for {name, value} <- pairs, do: entry(name, value) end
      changes = Enum.map(changes, encode)

      {bytes, written} =
        Enum.reduce(changes, file(encode.(base), [], []), fn change, {bytes, contents} ->
          case Format.append(contents, change) do
            {:ok, _, _} ->
              append(change, {bytes, contents})

            :full ->
              {bytes, contents} = Format.new(9, read!(bytes).entries, change)
              {IO.iodata_to_binary(bytes), contents}
          end
        end)

      contents = read!(bytes)

      contents.entries == List.flatten([encode.(base) | changes]) and
        contents.end_at == written.end_at and not contents.damaged?
    end
  end
end
