defmodule BB.Ring.VmTest do
  @moduledoc """
  The ring never crashes its VM, never keeps it from halting, never holds a scheduler, and leaves
  no threads, descriptors, mappings or memory. Some of these are counted for the whole VM, so
  nothing else may run meanwhile.
  """

  use ExUnit.Case, async: false

  import BB.Test.Eventually
  import BB.Test.Native, only: [topic: 0]

  alias BB.Ring
  alias BB.Ring.{Message, Publisher, Subscriber}

  @frame 2_000_000
  @frames [slot_count: 4, slot_size: 2_100_000]

  describe "an owner that is killed" do
    test "while publishing leaves a topic that continues, with no message torn or numbered twice" do
      topic = topic()
      options = [slot_count: 4, slot_size: 310_000]
      reader = Task.async(fn -> accept_until(topic, "the end") end)

      for _round <- 1..60 do
        {owner, publisher} = publishing_owner(topic, options)
        # Other processes publish through it too, and receive an error when its owner has exited.
        guest = Task.async(fn -> publish_for_ever(publisher) end)
        pause(8)
        kill(owner)
        assert Task.await(guest, :infinity) == :closed
        assert {:error, :closed} = Publisher.publish(publisher, "from the grave")
        assert {:error, :closed} = Publisher.info(publisher)
      end

      publisher = reopen(topic, options)
      accepted = publish_until_answered(publisher, "the end", reader)
      assert length(accepted) > 60
      assert Enum.all?(accepted, fn {_sequence, whole?} -> whole? end)
      sequences = Enum.map(accepted, &elem(&1, 0))
      assert sequences == sequences |> Enum.sort() |> Enum.dedup()
      assert {:ok, %{epoch: epoch}} = Publisher.info(publisher)
      assert epoch >= 60
    end

    test "while receiving leaves no reader slot and no thread" do
      topic = topic()
      {publishing, _publisher} = publishing_owner(topic, @frames)
      before = holdings()

      for _round <- 1..40 do
        owners =
          for active <- [true, 1, false] do
            spawn(fn -> receive_for_ever(topic, active) end)
          end

        pause(10)
        Enum.each(owners, &kill/1)
      end

      await_readers(topic, 0)
      assert_flat(before)
      kill(publishing)
    end
  end

  describe "ten thousand openings" do
    test "and closings of publishers and subscribers leave nothing behind" do
      topic = topic()
      open_and_close(topic, 200)
      before = holdings()
      open_and_close(topic, 10_000)
      assert_flat(before)
    end

    test "that fail leave nothing behind" do
      {_owner, publisher} = publishing_owner(topic(), slot_count: 4, slot_size: 310_000)
      broken = topic()
      File.write!("/dev/shm/conduit_#{broken}", String.duplicate("nonsense", 1000))

      fail = fn ->
        assert {:error, {:publisher_alive, _}} = Publisher.open(publisher.topic)
        assert {:error, {:not_a_ring, _, _}} = Subscriber.open(broken)
        assert {:error, {:not_a_ring, _, _}} = Ring.info(broken)
      end

      for _ <- 1..100, do: fail.()
      before = holdings()
      for _ <- 1..10_000, do: fail.()
      assert_flat(before)
    end

    # Closed in turn by close, by the death of the owner, and by a close during delivery.
    defp open_and_close(topic, times) do
      for n <- 1..times do
        {:ok, publisher} = Publisher.open(topic)
        owned = fn -> Subscriber.open(topic, active: true, start: :latest) end

        case rem(n, 3) do
          0 ->
            {:ok, subscriber} = owned.()
            :ok = Subscriber.close(subscriber)

          1 ->
            {owner, monitor} = spawn_monitor(owned)
            assert_receive {:DOWN, ^monitor, _, ^owner, :normal}

          2 ->
            {:ok, subscriber} = owned.()
            :ok = Publisher.publish(publisher, <<n::32>>)
            :ok = Subscriber.close(subscriber)
        end

        :ok = Publisher.close(publisher)
      end
    end
  end

  describe "garbage collection" do
    test "storms harm no message, and dropped messages and handles are freed" do
      topic = topic()
      {publishing, publisher} = publishing_owner(topic, @frames)
      before = holdings()

      stormy =
        for _ <- 1..4 do
          Task.async(fn ->
            {:ok, subscriber} = Subscriber.open(topic, active: 4)
            storm(subscriber, publisher, 40, [])
          end)
        end

      for kept <- Task.await_many(stormy, :infinity), do: assert(Enum.all?(kept, &proven?/1))
      await_readers(topic, 0)
      assert_flat(before)
      kill(publishing)
    end

    # Keeps some messages, drops others, collects at each, and passes the handles to processes
    # that drop them.
    defp storm(subscriber, _publisher, 0, kept) do
      :ok = Subscriber.close(subscriber)
      kept
    end

    defp storm(%{ref: ref} = subscriber, publisher, left, kept) do
      receive do
        {:bb_ring, ^ref, %Message{data: data}} ->
          holders =
            for _ <- 1..3,
                do: spawn(fn -> :erlang.garbage_collect() && {subscriber, publisher, data} end)

          :erlang.garbage_collect()
          Enum.each(holders, &:erlang.garbage_collect/1)
          assert proven?(data)

          storm(
            subscriber,
            publisher,
            left - 1,
            Enum.take([binary_part(data, 0, byte_size(data)) | kept], 3)
          )

        {:bb_ring_passive, ^ref} ->
          :ok = Subscriber.active(subscriber, 4)
          storm(subscriber, publisher, left, kept)

        {:bb_ring, ^ref, _event} ->
          storm(subscriber, publisher, left, kept)
      end
    end
  end

  describe "ten subscribers at once" do
    test "each receive every message, whole and in order" do
      topic = topic()
      {:ok, publisher} = Publisher.open(topic, slot_count: 1024, slot_size: 4096)

      readers =
        for _ <- 1..10 do
          Task.async(fn ->
            {:ok, subscriber} = Subscriber.open(topic, active: true)
            for n <- 0..999, do: accept(subscriber, n)
          end)
        end

      await_readers(topic, 10)
      messages = for _ <- 0..999, do: proof(:rand.uniform(4000))
      Enum.each(messages, &(:ok = Publisher.publish(publisher, &1)))
      for received <- Task.await_many(readers, :infinity), do: assert(received == messages)
    end

    defp accept(%{ref: ref} = subscriber, n) do
      receive do
        {:bb_ring, ^ref, %Message{sequence: ^n, lost: 0, data: data}} -> data
        {:bb_ring, ^ref, event} when is_atom(event) -> accept(subscriber, n)
      after
        20_000 -> flunk("message #{n} did not come")
      end
    end
  end

  describe "a VM that halts while ten subscribers receive messages" do
    @ways [
      {"System.halt", "System.halt(0)"},
      {"a halt that does not flush", ":erlang.halt(0, flush: false)"},
      {"an orderly stop", "System.stop(0)"}
    ]

    for {name, code} <- @ways do
      test "by #{name} ends with status 0 and leaves no reader slot and no crash dump" do
        topic = topic()
        {publishing, _publisher} = publishing_owner(topic, slot_count: 8, slot_size: 70_000)
        for _round <- 1..3, do: halt_node(topic, unquote(code))
        kill(publishing)
      end
    end

    defp halt_node(topic, code) do
      dump = Path.join(System.tmp_dir!(), "crash_dump.#{topic}")

      script = """
      for _ <- 1..10 do
        parent = self()
        spawn_link(fn ->
          {:ok, %{ref: ref}} = BB.Ring.Subscriber.open(#{inspect(topic)}, active: true)
          loop = fn loop, told ->
            receive do
              {:bb_ring, ^ref, %BB.Ring.Message{}} ->
                told || send(parent, :flows)
                loop.(loop, true)
              _ -> loop.(loop, told)
            end
          end
          loop.(loop, false)
        end)
      end
      for _ <- 1..10, do: (receive do :flows -> :ok end)
      IO.puts("flows")
      IO.read(:stdio, :line)
      #{code}
      Process.sleep(:infinity)
      """

      port =
        Port.open({:spawn_executable, System.find_executable("elixir")}, [
          :binary,
          :exit_status,
          :stderr_to_stdout,
          line: 1000,
          env: [{~c"ERL_CRASH_DUMP", String.to_charlist(dump)}],
          args: ["-pa", Application.app_dir(:ganglion, "ebin"), "-e", script]
        ])

      assert_receive {^port, {:data, {:eol, "flows"}}}
      assert {:ok, %{readers: readers}} = Ring.info(topic)
      assert length(readers) == 10
      Port.command(port, "go\n")
      assert_receive {^port, {:exit_status, status}}
      assert status == 0
      refute_received {^port, {:data, _complaint}}
      refute File.exists?(dump)
      # The next process takes the place of one that has exited.
      {:ok, subscriber} = Subscriber.open(topic)
      await_readers(topic, 1)
      :ok = Subscriber.close(subscriber)
    end
  end

  describe "schedulers" do
    # A copy of two megabytes takes well under a millisecond. A call that waited for another
    # process would sleep for half a second. The bound allows for a loaded machine, on which the
    # kernel suspends the scheduler's thread.
    @long_ms 200

    test "are not held for #{@long_ms} ms while frames of two megabytes are sent and received" do
      topic = topic()
      :erlang.system_monitor(self(), [{:long_schedule, @long_ms}])
      on_exit(fn -> :erlang.system_monitor(:undefined) end)
      {:ok, publisher} = Publisher.open(topic, @frames)
      test = self()

      readers =
        for active <- [true, 2, :once] do
          spawn_link(fn ->
            {:ok, subscriber} = Subscriber.open(topic, active: active)
            count_frames(subscriber, active, test, 0)
          end)
        end

      await_readers(topic, 3)
      frame = :binary.copy(<<7>>, @frame)

      for _ <- 1..200 do
        :ok = Publisher.publish(publisher, [frame])
        pause(4)
      end

      for reader <- readers do
        send(reader, :how_many)
        assert_receive {^reader, frames}
        assert frames > 0
      end

      held =
        for {:monitor, pid, :long_schedule, info} <- mailbox(), pid in [test | readers], do: info

      assert held == []
    end

    defp count_frames(%{ref: ref} = subscriber, active, test, frames) do
      receive do
        {:bb_ring, ^ref, %Message{data: <<7, _::binary>> = data}}
        when byte_size(data) == @frame ->
          if active == :once, do: :ok = Subscriber.active(subscriber, :once)
          count_frames(subscriber, active, test, frames + 1)

        {:bb_ring_passive, ^ref} ->
          :ok = Subscriber.active(subscriber, active)
          count_frames(subscriber, active, test, frames)

        :how_many ->
          send(test, {self(), frames})
      end
    end

    defp mailbox do
      receive do
        message -> [message | mailbox()]
      after
        0 -> []
      end
    end
  end

  # A checksum, then a block of random bytes, repeated: cheap to make and to check at any size.
  defp proof(size) do
    body = binary_part(:binary.copy(:crypto.strong_rand_bytes(64), div(size, 64) + 1), 0, size)
    <<:erlang.crc32(body)::32, body::binary>>
  end

  defp proven?(<<sum::32, body::binary>>), do: sum == :erlang.crc32(body)

  # Publishes messages of all sizes from the return of this function until it is killed.
  defp publishing_owner(topic, options) do
    test = self()

    owner =
      spawn(fn ->
        publisher = reopen(topic, options)
        send(test, {self(), publisher})
        publish_for_ever(publisher)
      end)

    assert_receive {^owner, publisher}
    on_exit(fn -> Process.exit(owner, :kill) end)
    {owner, publisher}
  end

  defp publish_for_ever(publisher) do
    size = Enum.random([0, 40, 4000, 60_000, 300_000, @frame])

    case Publisher.publish(publisher, proof(size)) do
      {:error, :closed} ->
        :closed

      # The longest message does not fit into every topic.
      result when result in [:ok, {:error, :message_too_large}] ->
        if :rand.uniform(4) == 1, do: pause(2)
        publish_for_ever(publisher)
    end
  end

  defp receive_for_ever(topic, active) do
    {:ok, subscriber} = Subscriber.open(topic, active: active)
    if active, do: Process.sleep(:infinity), else: recv_for_ever(subscriber)
  end

  defp recv_for_ever(subscriber) do
    {:ok, _message} = Subscriber.recv(subscriber)
    recv_for_ever(subscriber)
  end

  # The sequence number of each message, and whether it is whole, up to the last.
  defp accept_until(topic, last) do
    {:ok, subscriber} = Subscriber.open(topic)
    fn -> Subscriber.recv(subscriber, 20_000) end |> Stream.repeatedly() |> collect_until(last)
  end

  defp collect_until(received, last) do
    received
    |> Stream.map(fn {:ok, message} -> message end)
    |> Stream.take_while(&(&1.data != last))
    |> Enum.map(&{&1.sequence, proven?(&1.data)})
  end

  # A reader that is behind may lose it.
  defp publish_until_answered(publisher, data, task) do
    :ok = Publisher.publish(publisher, data)

    case Task.yield(task, 100) do
      {:ok, result} -> result
      nil -> publish_until_answered(publisher, data, task)
    end
  end

  # The process that held the topic may still be in its last publish.
  defp reopen(topic, options) do
    eventually(fn ->
      case Publisher.open(topic, options) do
        {:ok, publisher} -> publisher
        {:error, {:publisher_alive, _}} -> nil
      end
    end)
  end

  defp await_readers(topic, count) do
    eventually(fn ->
      {:ok, %{readers: readers}} = Ring.info(topic)
      length(readers) == count
    end)
  end

  defp pause(longest_ms) do
    receive do
    after
      :rand.uniform(longest_ms + 1) - 1 -> :ok
    end
  end

  defp kill(pid) do
    monitor = Process.monitor(pid)
    Process.exit(pid, :kill)
    assert_receive {:DOWN, ^monitor, _, _, _}
  end

  # The growth that is no leak: allocators keep some freed memory.
  @slack %{
    threads: 0,
    descriptors: 0,
    topics_mapped: 0,
    mappings: 60,
    bytes: 4_000_000,
    resident: 32_000_000
  }

  defp holdings do
    Enum.each(Process.list(), &:erlang.garbage_collect/1)
    maps = "/proc/self/maps" |> File.read!() |> String.split("\n")
    [_, kilobytes] = Regex.run(~r/VmRSS:\s+(\d+) kB/, File.read!("/proc/self/status"))

    %{
      threads: length(File.ls!("/proc/self/task")),
      descriptors: length(File.ls!("/proc/self/fd")),
      # A file without a name shows by its folder.
      topics_mapped: Enum.count(maps, &String.contains?(&1, "/dev/shm")),
      mappings: length(maps),
      bytes: :erlang.memory(:total),
      resident: String.to_integer(kilobytes) * 1024
    }
  end

  # Threads and terms are freed a moment after they have ended.
  defp assert_flat(before) do
    eventually(fn -> grown(before, holdings()) == [] end)
  rescue
    ExUnit.AssertionError ->
      now = holdings()
      flunk("#{inspect(grown(before, now))} grew, from #{inspect(before)} to #{inspect(now)}")
  end

  defp grown(before, now),
    do: for({what, slack} <- @slack, now[what] > before[what] + slack, do: what)
end
