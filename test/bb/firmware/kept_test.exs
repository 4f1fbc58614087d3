defmodule BB.Firmware.KeptTest do
  use ExUnit.Case, async: true

  import ExUnit.CaptureLog

  alias BB.Firmware.{Kept, Story}

  @moduletag :tmp_dir
  @first "first line\n"

  test "what is written is read again, in a folder that is made", %{tmp_dir: folder} do
    file = Path.join(folder, "a/b/text.txt")
    assert Kept.read(file, @first) == nil
    assert Kept.write(file, @first <> "one\n") == :ok
    assert Kept.write(file, @first <> "two\n") == :ok
    assert Kept.read(file, @first) == @first <> "two\n"
    assert File.ls!(Path.dirname(file)) == ["text.txt"]
    assert Kept.remove(file) == :ok
    assert Kept.remove(file) == :ok
    assert Kept.read(file, @first) == nil
  end

  test "a file that is damaged anywhere is never a text of another kind, and is kept aside", %{
    tmp_dir: folder
  } do
    file = Path.join(folder, "text.txt")
    text = @first <> "one\n"

    for size <- 0..(byte_size(@first) - 1) do
      File.write!(file, binary_part(text, 0, size))
      log = capture_log(fn -> assert Kept.read(file, @first) == nil end)
      assert log =~ "renamed to #{file}.corrupt"
      assert File.read!(file <> ".corrupt") == binary_part(text, 0, size)
    end

    File.write!(file, text <> <<0xFF>>)
    capture_log(fn -> assert Kept.read(file, @first) == nil end)
  end

  test "a folder that cannot be made is an error, whatever is asked", %{tmp_dir: folder} do
    File.write!(Path.join(folder, "file"), "")
    file = Path.join(folder, "file/text.txt")
    assert {:error, _} = Kept.write(file, @first)
    assert Kept.read(file, @first) == nil
    assert Kept.remove(file) == :ok

    log =
      capture_log(fn -> assert {:error, _} = Story.add(Path.join(folder, "file"), "it ended") end)

    assert log =~ "it ended"
    assert Story.recent(Path.join(folder, "file")) == []
  end

  test "a story has a line for each event, whoever tells it, and no end of them", %{
    tmp_dir: folder
  } do
    capture_log(fn ->
      1..8
      |> Enum.map(fn n -> Task.async(fn -> Story.add(folder, "event #{n}\nof many") end) end)
      |> Enum.each(&Task.await(&1, 60_000))
    end)

    lines = Story.recent(folder)
    assert length(lines) == 8
    for n <- 1..8, do: assert(Enum.any?(lines, &(&1 =~ "event #{n} of many")))
    for line <- lines, do: assert(line =~ ~r/^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ event/)

    capture_log(fn -> for n <- 1..120, do: Story.add(folder, "later #{n}") end)
    assert length(Story.recent(folder)) == 100
    assert [last] = Story.recent(folder, 1)
    assert last =~ "later 120"
  end

  test "any term is one line of text" do
    for term <- ["a\nb", <<0xFF>>, {:shutdown, String.duplicate("x", 1_000)}, nil, self()] do
      line = Kept.line(term)
      assert String.valid?(line) and not (line =~ "\n") and String.length(line) <= 300
    end
  end
end
