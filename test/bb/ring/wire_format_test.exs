defmodule BB.Ring.WireFormatTest do
  @moduledoc """
  Compares docs/wire-format.md with `BB.Ring`. The tests of the encodings compare their dumps.
  """

  use ExUnit.Case, async: true

  import BB.Test.Native, only: [topic: 0]

  alias BB.Ring.{Message, Publisher, Subscriber}
  alias BB.Test.Vectors

  # The offset and length of the bytes in which two files of the same content differ.
  @varies [{32, 16}, {80, 4}, {88, 16}, {1228, 8}, {1292, 8}]

  @options [slot_count: 2, slot_size: 64, content: "text/plain"]

  test "a publisher makes the segment that the page shows" do
    topic = topic()
    assert {:ok, publisher} = Publisher.open(topic, @options)
    assert segment(topic) == without_what_varies(Vectors.read!("empty_segment"))
    for n <- 0..2, do: assert(:ok = Publisher.publish(publisher, "message#{n}"))
    assert segment(topic) == without_what_varies(Vectors.read!("segment"))
  end

  test "a subscriber reads the segment that the page shows" do
    topic = topic()
    File.write!(file(topic), Vectors.read!("segment"))
    assert {:ok, subscriber} = Subscriber.open(topic, start: {:history, 16})

    for n <- 1..2 do
      assert {:ok, %Message{} = message} = Subscriber.recv(subscriber, 5_000)
      assert {message.sequence, message.data} == {n, "message#{n}"}
    end
  end

  test "the state of a segment is as the page says" do
    topic = topic()
    File.write!(file(topic), Vectors.read!("segment"))

    assert {:ok, %{slot_count: 2, slot_size: 64, state: :dead, published: 3} = info} =
             BB.Ring.info(topic)

    assert {info.writer_pid, info.last_publish_ns} == {12_345, 1_234_567_890_123_456_789}
  end

  defp file(topic), do: "/dev/shm/conduit_#{topic}"
  defp segment(topic), do: topic |> file() |> File.read!() |> without_what_varies()

  defp without_what_varies(segment) do
    Enum.reduce(@varies, segment, fn {at, length}, segment ->
      {before, found} = :erlang.split_binary(segment, at)
      {_varies, rest} = :erlang.split_binary(found, length)
      <<before::binary, 0::size(length)-unit(8), rest::binary>>
    end)
  end
end
