defmodule BB.Ring.LanguagesTest do
  @moduledoc """
  C++, Python, Rust and Elixir at once on four topics, one of each: native/languages/README.md.
  """

  use ExUnit.Case, async: true

  import BB.Test.Native, only: [topic: 1]

  alias BB.Ring.{Message, Publisher, Subscriber}
  alias BB.Test.Languages

  @programs ~w(cpp python rust)
  @count 500
  @window 16
  # Longer than any pause, so that only a failing peer is waited for so long.
  @limit 60_000

  # On a new machine packages are fetched and compiled first.
  @moduletag timeout: 600_000

  setup_all do
    Languages.build!()
  end

  test "C++, Python, Rust and Elixir exchange checksummed messages in every direction" do
    topics = Map.new(["elixir" | @programs], &{&1, topic(&1)})
    {own, others} = Map.pop!(topics, "elixir")

    subscribers = for {_, topic} <- others, do: open!(Subscriber, topic, active: true)
    slots = [slot_count: 64, slot_size: Languages.slot_size()]
    publisher = open!(Publisher, own, slots)

    peers = Map.new(@programs, &{start(&1, topics), &1})
    for {port, program} <- peers, do: assert(line(port, peers) == "ready", program)
    Enum.each(Map.keys(peers), &go/1)

    received = exchange(publisher, subscribers, peers)
    assert received == Map.new(others, fn {_, topic} -> {topic, {@count, bytes(topic)}} end)

    for {port, program} <- peers do
      expected =
        for {from, topic} <- topics,
            from != program,
            do: "verified #{topic} #{@count} #{bytes(topic)}"

      lines = for _topic <- expected, do: line(port, peers)
      assert Enum.sort(lines) == Enum.sort(expected), program
    end

    Enum.each(Map.keys(peers), &go/1)
    for {port, program} <- peers, do: assert_receive({^port, {:exit_status, 0}}, @limit, program)
  end

  defp open!(module, topic, options) do
    assert {:ok, opened} = module.open(topic, options)
    opened
  end

  defp start(program, topics) do
    {own, others} = Map.pop!(topics, program)
    [executable | arguments] = Languages.command(program)
    arguments = arguments ++ [to_string(@count), own | Map.values(others)]

    Port.open({:spawn_executable, executable}, [
      :binary,
      :exit_status,
      :stderr_to_stdout,
      line: 1000,
      args: arguments,
      # A node reports when a publisher opens and closes.
      env: [{~c"CONDUIT_LOG", ~c"error"}]
    ])
  end

  defp go(port), do: Port.command(port, "\n")

  defp line(port, peers) do
    receive do
      {^port, {:data, {:eol, line}}} -> line
      {port, {:exit_status, status}} -> flunk(ended(port, status, peers))
    after
      @limit -> flunk("#{peers[port]} says nothing")
    end
  end

  defp ended(port, status, peers) do
    receive do
      {^port, {:data, {_, text}}} -> "#{peers[port]} ended with #{status}: #{text}"
    after
      0 -> "#{peers[port]} ended with #{status}"
    end
  end

  # Publishes and reads until all messages of each topic have come: {messages, bytes} of each.
  defp exchange(publisher, subscribers, peers) do
    received = Map.new(subscribers, &{&1.topic, {0, 0}})
    topics = Map.new(subscribers, &{&1.ref, &1.topic})
    go_on(0, received, %{publisher: publisher, topics: topics, peers: peers})
  end

  defp go_on(next, received, ring) do
    next = publish(next, least(received), ring.publisher)

    if next == @count and least(received) == @count,
      do: received,
      else: go_on(next, read(received, ring), ring)
  end

  defp least(received), do: received |> Map.values() |> Enum.min() |> elem(0)

  # Message n is published once message n - @window of every other topic has come, so that no
  # reader is ever overtaken.
  defp publish(next, least, publisher) when next < @count and next + 1 - @window <= least do
    assert :ok = Publisher.publish(publisher, Languages.message(publisher.topic, next))
    publish(next + 1, least, publisher)
  end

  defp publish(next, _least, _publisher), do: next

  defp read(received, %{topics: topics, peers: peers} = ring) do
    receive do
      {:bb_ring, ref, %Message{} = message} when is_map_key(topics, ref) ->
        topic = topics[ref]
        Map.update!(received, topic, &verified(&1, topic, message))

      {:bb_ring, ref, :publisher_up} when is_map_key(topics, ref) ->
        read(received, ring)

      {port, {:exit_status, status}} when is_map_key(peers, port) ->
        flunk(ended(port, status, peers))
    after
      @limit -> flunk("nothing comes any more after #{inspect(received)}")
    end
  end

  defp verified({next, bytes}, topic, message) do
    assert {message.sequence, message.lost} == {next, 0}
    assert message.data == Languages.message(topic, next), "message #{next} of #{topic} is torn"
    {next + 1, bytes + byte_size(message.data)}
  end

  defp bytes(topic),
    do: Enum.sum(for n <- 0..(@count - 1), do: byte_size(Languages.message(topic, n)))
end
