defmodule BB.RingTest do
  use ExUnit.Case, async: true

  alias BB.Ring
  alias BB.Ring.{Message, Publisher, Subscriber}

  doctest BB.Ring

  setup context do
    Map.put(context, :topic, BB.Test.Native.topic())
  end

  defp open!(topic, opts \\ []) do
    {:ok, publisher} = Publisher.open(topic, opts)
    publisher
  end

  defp subscribe!(topic, opts \\ []) do
    {:ok, subscriber} = Subscriber.open(topic, opts)
    subscriber
  end

  defp path(topic), do: "/dev/shm/conduit_#{topic}"

  # An open publisher has the subscriber attached once its reader slot shows.
  defp await_readers(topic, count) do
    {:ok, info} = Ring.info(topic)

    unless length(info.readers) == count do
      Process.sleep(1)
      await_readers(topic, count)
    end
  end

  defp attached!(topic, opts \\ []) do
    subscriber = subscribe!(topic, opts)
    await_readers(topic, 1)
    subscriber
  end

  describe "publishing" do
    test "a subscriber receives the published messages, in order and numbered", %{topic: topic} do
      publisher = open!(topic)
      %{ref: ref} = attached!(topic, active: true)
      for n <- 0..9, do: :ok = Publisher.publish(publisher, "message #{n}")

      for n <- 0..9 do
        text = "message #{n}"

        assert_receive {:bb_ring, ^ref,
                        %Message{sequence: ^n, data: ^text, lost: 0, timestamp_ns: time}}

        assert time <= Ring.now_ns()
      end
    end

    test "iodata of every shape arrives as its bytes", %{topic: topic} do
      publisher = open!(topic)
      %{ref: ref} = attached!(topic, active: true)
      iodata = [?a, "b", [[], [<<99>>, ~c"de"]] | "f"]
      :ok = Publisher.publish(publisher, iodata)
      assert_receive {:bb_ring, ^ref, %Message{data: "abcdef"}}
    end

    test "an empty message is a message", %{topic: topic} do
      publisher = open!(topic)
      %{ref: ref} = attached!(topic, active: true)
      :ok = Publisher.publish(publisher, "")
      assert_receive {:bb_ring, ^ref, %Message{data: "", sequence: 0}}
    end

    test "a message of two megabytes arrives whole", %{topic: topic} do
      publisher = open!(topic, slot_count: 4, slot_size: 2_100_000)
      subscriber = attached!(topic)
      frame = :crypto.strong_rand_bytes(2_000_000)

      :ok =
        Publisher.publish(publisher, [
          binary_part(frame, 0, 1000),
          binary_part(frame, 1000, 1_999_000)
        ])

      assert {:ok, %Message{data: ^frame}} = Subscriber.recv(subscriber, 5000)
    end

    test "a message that does not fit is refused, and no part of it is read", %{topic: topic} do
      publisher = open!(topic, depth: 2, max_message_size: 100)
      {:ok, %{max_message_size: size}} = Publisher.info(publisher)
      %{ref: ref} = attached!(topic, active: true)

      assert {:error, :message_too_large} =
               Publisher.publish(publisher, String.duplicate("x", size + 1))

      assert :ok = Publisher.publish(publisher, String.duplicate("y", size))
      assert_receive {:bb_ring, ^ref, %Message{sequence: 0, data: "y" <> _}}
      assert {:ok, %{published: 1, rejected_oversize: 1}} = Publisher.info(publisher)
    end

    test "several processes publish on one ring, and no message is lost or mixed", %{
      topic: topic
    } do
      publisher = open!(topic, slot_count: 4096, slot_size: 64)
      %{ref: ref} = attached!(topic, active: true)

      1..4
      |> Enum.map(fn who ->
        Task.async(fn ->
          for n <- 1..250, do: :ok = Publisher.publish(publisher, "#{who}:#{n}")
        end)
      end)
      |> Task.await_many(:infinity)

      received =
        for sequence <- 0..999 do
          assert_receive {:bb_ring, ^ref, %Message{sequence: ^sequence, data: data, lost: 0}}

          data
        end

      for who <- 1..4 do
        assert Enum.filter(received, &String.starts_with?(&1, "#{who}:")) ==
                 for(n <- 1..250, do: "#{who}:#{n}")
      end
    end

    test "after close nothing is published and the topic is removed", %{topic: topic} do
      publisher = open!(topic)
      :ok = Publisher.close(publisher)
      assert {:error, :closed} = Publisher.publish(publisher, "late")
      assert {:error, :closed} = Publisher.info(publisher)
      assert :ok = Publisher.close(publisher)
      assert {:error, {:no_topic, _path}} = Ring.info(topic)
    end
  end

  describe "a topic's one publisher" do
    test "a second one is refused with the first one's process number", %{topic: topic} do
      _publisher = open!(topic)
      os_pid = String.to_integer(System.pid())
      assert {:error, {:publisher_alive, ^os_pid} = reason} = Publisher.open(topic)
      assert Ring.format_error(reason) =~ "process #{os_pid}"
    end

    test "leaves the topic when its owner dies, and the next one continues in place", %{
      topic: topic
    } do
      test = self()

      {owner, monitor} =
        spawn_monitor(fn ->
          publisher = open!(topic)
          for n <- 0..4, do: :ok = Publisher.publish(publisher, "old #{n}")
          send(test, {:publisher, publisher})
          Process.sleep(:infinity)
        end)

      assert_receive {:publisher, old}
      %{ref: ref} = attached!(topic, active: true, start: {:history, 5})
      for n <- 0..4, do: assert_receive({:bb_ring, ^ref, %Message{sequence: ^n}})

      Process.exit(owner, :kill)
      assert_receive {:DOWN, ^monitor, _, _, :killed}
      new = reopen(topic)
      assert {:error, :closed} = Publisher.publish(old, "from the grave")
      :ok = Publisher.publish(new, "new")
      assert_receive {:bb_ring, ^ref, %Message{sequence: 5, data: "new", lost: 0}}
      assert {:ok, %{epoch: 1, published: 6}} = Ring.info(topic)
    end

    test "slots of another size retire the old file, and subscribers follow", %{topic: topic} do
      test = self()

      {owner, monitor} =
        spawn_monitor(fn ->
          publisher = open!(topic, slot_count: 4, slot_size: 128)
          send(test, :open)
          :ok = Publisher.publish(publisher, "old")
          Process.sleep(:infinity)
        end)

      assert_receive :open
      %{ref: ref} = attached!(topic, active: true, start: {:history, 4})
      assert_receive {:bb_ring, ^ref, %Message{data: "old"}}
      Process.exit(owner, :kill)
      assert_receive {:DOWN, ^monitor, _, _, :killed}

      new = reopen(topic, slot_count: 8, slot_size: 256)
      await_readers(topic, 1)
      :ok = Publisher.publish(new, "new")
      assert_receive {:bb_ring, ^ref, %Message{data: "new"}}
    end

    # The monitor of the resource fires at about the same time as this process's own.
    defp reopen(topic, opts \\ []) do
      case Publisher.open(topic, opts) do
        {:ok, publisher} -> publisher
        {:error, {:publisher_alive, _}} -> reopen(topic, opts)
      end
    end
  end

  describe "a topic's size and name" do
    test "a message above the given size is too large, also where the file rounds it up", %{
      topic: topic
    } do
      publisher = open!(topic, slot_count: 4, slot_size: 4100)
      :ok = Publisher.publish(publisher, :binary.copy("x", 4080))

      assert {:error, :message_too_large} = Publisher.publish(publisher, :binary.copy("x", 4081))

      assert {:ok, %{slot_size: 4160, max_message_size: 4080}} = Ring.info(topic)
    end

    test "the largest number of slots is that of the ring itself", %{topic: topic} do
      publisher = open!(topic, slot_count: 1_048_576, slot_size: 64)
      assert {:ok, %{slot_count: 1_048_576}} = Publisher.info(publisher)
      :ok = Publisher.close(publisher)

      assert_raise BB.Options.ValidationError, ~r/to 1048576, got: 2097152/, fn ->
        Publisher.open(topic, slot_count: 2_097_152)
      end
    end

    test "names by other rules are read, not made", %{topic: topic} do
      for name <- ["cam 1", "front:rgb", "größe"] do
        publisher = open!(topic)
        found = "#{name} #{topic}"
        on_exit(fn -> File.rm("/dev/shm/conduit_#{found}") end)
        File.rename!("/dev/shm/conduit_#{topic}", "/dev/shm/conduit_#{found}")
        %{ref: ref} = attached!(found, active: true)
        :ok = Publisher.publish(publisher, name)
        assert_receive {:bb_ring, ^ref, %Message{data: ^name}}, 30_000
        assert_raise ArgumentError, ~r/A-Z a-z 0-9/, fn -> Publisher.open(found) end
        :ok = Publisher.close(publisher)
      end

      for name <- ["", "a/b", "a\0", "a\n", <<0xFF>>, String.duplicate("x", 248), :atom] do
        assert_raise ArgumentError, ~r/expected a topic's name/, fn -> Ring.info(name) end
        assert_raise ArgumentError, ~r/expected a topic's name/, fn -> Subscriber.open(name) end
      end
    end

    test "the errors of the system are formatted" do
      full = {:system, "/dev/shm/conduit_x", "create", 28}
      assert Ring.format_error(full) =~ "create failed: no space left in /dev/shm; remove topics"
      denied = {:system, "/dev/shm/conduit_x", "open", 13}
      assert Ring.format_error(denied) == "/dev/shm/conduit_x: open failed: permission denied"
    end
  end

  describe "a subscriber" do
    test "may be opened before its topic", %{topic: topic} do
      %{ref: ref} = subscribe!(topic, active: true)
      publisher = open!(topic)
      await_readers(topic, 1)
      :ok = Publisher.publish(publisher, "first")
      assert_receive {:bb_ring, ^ref, %Message{data: "first"}}
    end

    test "receives a message when the publisher closes and when another one opens", %{
      topic: topic
    } do
      publisher = open!(topic)
      %{ref: ref} = attached!(topic, active: true)
      :ok = Publisher.close(publisher)
      assert_receive {:bb_ring, ^ref, :publisher_down}
      publisher = open!(topic)
      assert_receive {:bb_ring, ^ref, :publisher_up}
      await_readers(topic, 1)
      :ok = Publisher.publish(publisher, "again")
      assert_receive {:bb_ring, ^ref, %Message{data: "again"}}
    end

    test "can start with the messages that the ring still has", %{topic: topic} do
      publisher = open!(topic)
      for n <- 0..9, do: :ok = Publisher.publish(publisher, "#{n}")

      assert {:ok, %Message{data: "9"}} =
               topic |> subscribe!(start: :latest) |> Subscriber.recv(2000)

      assert {:ok, %Message{data: "7"}} =
               topic |> subscribe!(start: {:history, 3}) |> Subscriber.recv(2000)
    end

    test "that falls behind receives the number of lost messages", %{topic: topic} do
      publisher = open!(topic, slot_count: 4, slot_size: 64)
      subscriber = attached!(topic)
      for n <- 0..9, do: :ok = Publisher.publish(publisher, "#{n}")

      assert {:ok, %Message{sequence: sequence, lost: lost, data: data}} =
               Subscriber.recv(subscriber, 2000)

      assert {sequence, lost, data} == {6, 6, "6"}
    end

    test "that is closed releases its place and receives nothing more", %{topic: topic} do
      publisher = open!(topic)
      %{ref: ref} = subscriber = attached!(topic, active: true)
      :ok = Publisher.publish(publisher, "unread")
      :ok = Subscriber.close(subscriber)
      :ok = Publisher.publish(publisher, "late")
      assert {:ok, %{readers: []}} = Ring.info(topic)
      refute_received {:bb_ring, ^ref, _}
      assert {:error, :closed} = Subscriber.recv(subscriber, 0)
      assert {:error, :closed} = Subscriber.latest(subscriber)
      assert {:error, :closed} = Subscriber.active(subscriber, 1)
      assert :ok = Subscriber.close(subscriber)
    end

    test "is released when its owner dies", %{topic: topic} do
      _publisher = open!(topic)
      test = self()

      owner =
        spawn(fn ->
          send(test, {:open, attached!(topic)})
          Process.sleep(:infinity)
        end)

      assert_receive {:open, _}
      Process.exit(owner, :kill)
      await_readers(topic, 0)
    end

    test "lives as long as its owner, whichever process refers to it", %{topic: topic} do
      publisher = open!(topic)
      %{ref: ref} = attached!(topic, active: true)
      :erlang.garbage_collect()
      :ok = Publisher.publish(publisher, "still here")
      assert_receive {:bb_ring, ^ref, %Message{data: "still here"}}
    end

    test "that is guarded survives the truncation of its file, and reports it", %{topic: topic} do
      publisher = open!(topic)
      %{ref: ref} = subscribe!(topic, active: true, guard: :always)
      :ok = Publisher.publish(publisher, "whole")
      assert_receive {:bb_ring, ^ref, %Message{data: "whole"}}
      {_, 0} = System.cmd("truncate", ["--size=0", "/dev/shm/conduit_#{topic}"])
      assert_receive {:bb_ring, ^ref, :publisher_down}

      # The publisher, which maps the file, is not used from here on, and ends with this process.
    end

    test "a topic has sixteen places, and a seventeenth subscriber is an error", %{topic: topic} do
      _publisher = open!(topic)
      for _ <- 1..16, do: subscribe!(topic)
      await_readers(topic, 16)
      assert {:error, {:no_reader_slot, _path} = reason} = Subscriber.open(topic)
      assert Ring.format_error(reason) =~ "16 subscribers"
    end
  end

  describe "a subscriber with a content" do
    @imu "sensor_msgs/msg/Imu"
    @scan "sensor_msgs/msg/LaserScan"

    test "is refused on a topic of another content, and on one without a tag", %{topic: topic} do
      for {opts, tag} <- [{[content: @scan], Ring.content_tag(@scan)}, {[], 0}] do
        publisher = open!(topic, opts)
        assert {:error, {:other_content, ^tag} = reason} = Subscriber.open(topic, content: @imu)
        assert Ring.format_error(reason) =~ "content tag"
        assert {:ok, %{readers: []}} = Ring.info(topic)
        Publisher.close(publisher)
      end
    end

    test "receives messages of its content, and with untagged those without a tag", %{
      topic: topic
    } do
      for {of, opts} <- [{[content: @imu], []}, {[], [untagged: true]}] do
        publisher = open!(topic, of)
        subscriber = attached!(topic, [content: @imu] ++ opts)
        :ok = Publisher.publish(publisher, "hello")
        assert {:ok, %Message{data: "hello"}} = Subscriber.recv(subscriber, 60_000)
        Subscriber.close(subscriber)
        Publisher.close(publisher)
      end
    end

    test "receives one error about another content, none of its messages, and later its own", %{
      topic: topic
    } do
      %{ref: ref} = subscriber = subscribe!(topic, content: @imu, active: true)

      for _ <- 1..2 do
        other = open!(topic, content: @scan)
        tag = Ring.content_tag(@scan)
        assert_receive {:bb_ring, ^ref, {:error, {:other_content, ^tag}}}, 60_000
        for n <- 1..10, do: :ok = Publisher.publish(other, "other #{n}")
        Publisher.close(other)
        assert_receive {:bb_ring, ^ref, :publisher_down}, 60_000

        mine = open!(topic, content: @imu)
        assert_receive {:bb_ring, ^ref, :publisher_up}, 60_000
        await_readers(topic, 1)
        :ok = Publisher.publish(mine, "mine")
        assert_receive {:bb_ring, ^ref, %Message{data: "mine"}}, 60_000
        Publisher.close(mine)
        assert_receive {:bb_ring, ^ref, :publisher_down}, 60_000
      end

      refute_received {:bb_ring, ^ref, %Message{}}
      refute_received {:bb_ring, ^ref, {:error, _}}
      Subscriber.close(subscriber)
    end

    test "receives nothing of another content by recv either", %{topic: topic} do
      subscriber = subscribe!(topic, content: @imu, start: {:history, 10})
      other = open!(topic, content: @scan, slot_count: 16, slot_size: 262_144)
      await_attached(topic, subscriber)
      for _ <- 1..3, do: :ok = Publisher.publish(other, :binary.copy("x", 200_000))
      assert {:error, :empty} = Subscriber.latest(subscriber)
      assert {:error, :empty} = Subscriber.with_frame(subscriber, &flunk(inspect(&1)))
      assert {:error, :timeout} = Subscriber.recv(subscriber, 50)
    end

    # A passive subscriber looks for its topic at each recv.
    defp await_attached(topic, subscriber) do
      {:error, :empty} = Subscriber.latest(subscriber)

      case Ring.info(topic) do
        {:ok, %{readers: [_]}} ->
          :ok

        _ ->
          Process.sleep(1)
          await_attached(topic, subscriber)
      end
    end
  end

  describe "active" do
    setup %{topic: topic} do
      {:ok, publisher: open!(topic, slot_count: 64, slot_size: 64)}
    end

    test "a number is that many messages, then a message that the credits are used up", %{
      topic: topic,
      publisher: publisher
    } do
      %{ref: ref} = subscriber = attached!(topic, active: 2)
      for n <- 0..4, do: :ok = Publisher.publish(publisher, "#{n}")
      assert_receive {:bb_ring, ^ref, %Message{data: "0"}}
      assert_receive {:bb_ring, ^ref, %Message{data: "1"}}
      assert_receive {:bb_ring_passive, ^ref}
      assert {:ok, %Message{data: "2", lost: 0}} = Subscriber.recv(subscriber, 1000)
      refute_received {:bb_ring, ^ref, _}
    end

    test "numbers add up, and a negative one that cancels them makes passive at once", %{
      topic: topic,
      publisher: publisher
    } do
      %{ref: ref} = subscriber = attached!(topic, active: 1)
      :ok = Subscriber.active(subscriber, 2)
      for n <- 0..2, do: :ok = Publisher.publish(publisher, "#{n}")
      for n <- 0..2, do: assert_receive({:bb_ring, ^ref, %Message{sequence: ^n}})
      assert_receive {:bb_ring_passive, ^ref}
      :ok = Subscriber.active(subscriber, 3)
      :ok = Subscriber.active(subscriber, -3)
      assert_receive {:bb_ring_passive, ^ref}
    end

    test ":once is one message", %{topic: topic, publisher: publisher} do
      %{ref: ref} = subscriber = attached!(topic, active: :once)
      for n <- 0..1, do: :ok = Publisher.publish(publisher, "#{n}")
      assert_receive {:bb_ring, ^ref, %Message{data: "0"}}
      :ok = Subscriber.active(subscriber, :once)
      assert_receive {:bb_ring, ^ref, %Message{data: "1"}}
      refute_received {:bb_ring_passive, ^ref}
    end

    test ":once after each message delivers the next one, again and again", %{
      topic: topic,
      publisher: publisher
    } do
      %{ref: ref} = subscriber = attached!(topic, active: :once)

      for n <- 0..4999 do
        :ok = Publisher.publish(publisher, "#{n}")
        assert_receive {:bb_ring, ^ref, %Message{sequence: ^n}}
        :ok = Subscriber.active(subscriber, :once)
      end
    end

    test "recv may follow the message of :once directly", %{
      topic: topic,
      publisher: publisher
    } do
      %{ref: ref} = subscriber = attached!(topic, active: false)

      for n <- 0..499 do
        :ok = Subscriber.active(subscriber, :once)
        for m <- [2 * n, 2 * n + 1], do: :ok = Publisher.publish(publisher, "#{m}")
        assert_receive {:bb_ring, ^ref, %Message{}}
        assert {:ok, %Message{}} = Subscriber.recv(subscriber, 5000)
      end
    end

    test "without credits the ring continues, and the loss is counted", %{
      topic: topic,
      publisher: publisher
    } do
      %{ref: ref} = subscriber = attached!(topic, active: 1)
      :ok = Publisher.publish(publisher, "0")
      assert_receive {:bb_ring, ^ref, %Message{data: "0"}}
      assert_receive {:bb_ring_passive, ^ref}
      for n <- 1..99, do: :ok = Publisher.publish(publisher, "#{n}")
      :ok = Subscriber.active(subscriber, true)
      assert_receive {:bb_ring, ^ref, %Message{sequence: 36, lost: 35}}
      for n <- 37..99, do: assert_receive({:bb_ring, ^ref, %Message{sequence: ^n, lost: 0}})
    end

    test "recv is for passive subscribers only", %{topic: topic} do
      subscriber = attached!(topic, active: true)
      assert {:error, :active} = Subscriber.recv(subscriber, 0)
    end

    test "recv ends with its timeout, and a later message is not lost", %{
      topic: topic,
      publisher: publisher
    } do
      subscriber = attached!(topic)
      assert {:error, :timeout} = Subscriber.recv(subscriber, 0)
      assert {:error, :timeout} = Subscriber.recv(subscriber, 20)
      :ok = Publisher.publish(publisher, "late")
      assert {:ok, %Message{data: "late", lost: 0}} = Subscriber.recv(subscriber, 1000)
    end

    test "recv in several processes returns each message once", %{
      topic: topic,
      publisher: publisher
    } do
      subscriber = attached!(topic)
      tasks = for _ <- 1..8, do: Task.async(fn -> Subscriber.recv(subscriber, 5000) end)
      for n <- 0..7, do: :ok = Publisher.publish(publisher, "#{n}")
      sequences = for {:ok, message} <- Task.await_many(tasks, :infinity), do: message.sequence
      assert Enum.sort(sequences) == Enum.to_list(0..7)
    end

    test "latest skips to the newest and counts the skipped messages", %{
      topic: topic,
      publisher: publisher
    } do
      subscriber = attached!(topic)
      assert {:error, :empty} = Subscriber.latest(subscriber)
      for n <- 0..9, do: :ok = Publisher.publish(publisher, "#{n}")
      assert {:ok, %Message{sequence: 9, lost: 9}} = Subscriber.latest(subscriber)
      assert {:error, :empty} = Subscriber.latest(subscriber)
    end
  end

  describe "a topic whose file is removed" do
    import BB.Test.Eventually

    test "is made again also while nothing is published; owner and readers receive a message", %{
      topic: topic
    } do
      publisher = open!(topic)
      %{ref: ref} = attached!(topic, active: true)
      :ok = Publisher.publish(publisher, "before")
      assert_receive {:bb_ring, ^ref, %Message{data: "before", sequence: 0}}, 30_000
      File.rm!(path(topic))
      assert_receive {:bb_ring_publisher, ^topic, :renewed}, 30_000
      assert {:ok, %{state: :live, published: 1, epoch: 1}} = Ring.info(topic)
      assert_receive {:bb_ring, ^ref, :publisher_down}, 30_000
      assert_receive {:bb_ring, ^ref, :publisher_up}, 30_000
      :ok = Publisher.publish(publisher, "after")
      assert_receive {:bb_ring, ^ref, %Message{data: "after", sequence: 1, lost: 0}}, 30_000
      assert {:ok, late} = Subscriber.open(topic, start: {:history, 2})
      assert {:ok, %Message{data: "before"}} = Subscriber.recv(late, 30_000)
    end

    test "and whose name another publisher takes is an error until the name is free", %{
      topic: topic
    } do
      publisher = open!(topic)
      assert_lost(publisher, topic, usurp(topic))
    end

    # The publisher checks several times a second, and may have its name again before another one.
    defp usurp(topic) do
      File.rm!(path(topic))

      case Publisher.open(topic) do
        {:ok, usurper} -> usurper
        {:error, {:publisher_alive, _}} -> usurp(topic)
      end
    end

    defp assert_lost(publisher, topic, usurper) do
      own = String.to_integer(System.pid())
      reason = {:publisher_alive, own}
      assert_receive {:bb_ring_publisher, ^topic, {:error, ^reason}}, 30_000
      assert {:error, ^reason} = Publisher.publish(publisher, "nobody hears")
      :ok = Publisher.close(usurper)
      eventually(fn -> Publisher.publish(publisher, "on") == :ok end, 30_000)
      assert {:ok, %{state: :live}} = Ring.info(topic)
    end
  end

  describe "with_frame" do
    setup %{topic: topic} do
      publisher = open!(topic, slot_count: 4, slot_size: 200_000)
      {:ok, publisher: publisher, subscriber: attached!(topic)}
    end

    defp frame(n), do: :binary.copy(<<n>>, 150_000)

    # The first lease of a subscription may have to be a copy.
    defp published!(publisher, n), do: :ok = Publisher.publish(publisher, frame(n))

    defp held(topic) do
      {:ok, %{readers: readers}} = Ring.info(topic)
      Enum.sum(for reader <- readers, do: reader.leases)
    end

    test "lends the newest message and counts the skipped ones", %{
      publisher: publisher,
      subscriber: subscriber
    } do
      for n <- 0..2, do: published!(publisher, n)

      assert {:ok, {2, 2, true}} =
               Subscriber.with_frame(subscriber, fn message ->
                 {message.sequence, message.lost, message.data == frame(2)}
               end)

      assert {:error, :empty} = Subscriber.with_frame(subscriber, &flunk(inspect(&1)))
    end

    test "holds the slot while the function runs, and no longer", %{
      topic: topic,
      publisher: publisher,
      subscriber: subscriber
    } do
      published!(publisher, 0)

      assert {:ok, :seen} =
               Subscriber.with_frame(subscriber, fn %{data: data} ->
                 assert held(topic) == 1
                 for n <- 1..3, do: published!(publisher, n)

                 for _ <- 1..10, do: :ok = Publisher.publish(publisher, "around it")

                 assert data == frame(0)
                 {:ok, %{readers: [%{held: [0], os_pid: holder}]}} = Ring.info(topic)
                 assert holder == String.to_integer(System.pid())
                 :seen
               end)

      assert held(topic) == 0
      published!(publisher, 4)
      # 4, 8, 12 and 16 are the numbers of the held slot.
      assert {:ok, %{published: 19, dropped_pinned: 4}} = Ring.info(topic)
    end

    test "stops no other subscriber, which counts the messages lost by it", %{
      topic: topic,
      publisher: publisher,
      subscriber: subscriber
    } do
      other = subscribe!(topic)
      await_readers(topic, 2)
      published!(publisher, 0)

      assert {:ok, lost} =
               Subscriber.with_frame(subscriber, fn _held ->
                 for n <- 1..20, reduce: 0 do
                   lost ->
                     published!(publisher, n)
                     {:ok, %Message{} = message} = Subscriber.latest(other)
                     assert message.data == frame(n)
                     lost + message.lost
                 end
               end)

      assert {:ok, %{dropped_pinned: passed}} = Ring.info(topic)
      # `latest` skipped the first frame.
      assert passed > 0 and lost == passed + 1
    end

    test "drops a message with an error when all slots are held", %{topic: topic} do
      one = topic <> ".one"
      on_exit(fn -> File.rm("/dev/shm/conduit_#{one}") end)
      publisher = open!(one, slot_count: 1, slot_size: 200_000)
      subscriber = attached!(one)
      published!(publisher, 0)
      assert {:ok, _copy} = Subscriber.with_frame(subscriber, & &1.sequence)
      published!(publisher, 1)

      assert {:ok, {:error, :slot_held}} =
               Subscriber.with_frame(subscriber, fn _held ->
                 Publisher.publish(publisher, "dropped")
               end)

      assert Ring.format_error(:slot_held) =~ "all slots"
    end

    test "copies kept parts, and nothing else", %{publisher: publisher, subscriber: subscriber} do
      :erlang.trace_pattern({BB.Ring.Native, :lease_detach, 1}, true, [:local])
      test = self()

      reader =
        spawn_link(fn ->
          receive do: (:go -> :ok)
          send(test, Subscriber.with_frame(subscriber, fn %{data: <<n, _::binary>>} -> n end))
          receive do: (:go -> :ok)
          send(test, Subscriber.with_frame(subscriber, & &1.data))
        end)

      1 = :erlang.trace(reader, true, [:call])
      published!(publisher, 5)
      send(reader, :go)
      assert_receive {:ok, 5}
      delivered = :erlang.trace_delivered(reader)
      assert_receive {:trace_delivered, ^reader, ^delivered}
      refute_received {:trace, ^reader, :call, _}

      published!(publisher, 6)
      send(reader, :go)
      assert_receive {:trace, ^reader, :call, {BB.Ring.Native, :lease_detach, _}}
      assert_receive {:ok, data}
      assert data == frame(6)
    end

    test "a message that is kept never changes, and its slot is free", %{
      topic: topic,
      publisher: publisher,
      subscriber: subscriber
    } do
      kept =
        for n <- 0..20 do
          published!(publisher, n)

          {:ok, kept} =
            Subscriber.with_frame(subscriber, fn %{data: data} ->
              if rem(n, 2) == 0, do: data, else: binary_part(data, 10, 100_000)
            end)

          assert held(topic) == 0
          kept
        end

      :ok = Subscriber.close(subscriber)
      for n <- 100..120, do: published!(publisher, n)
      :ok = Publisher.close(publisher)

      for {data, n} <- Enum.with_index(kept),
          do: assert(data == binary_part(frame(n), 0, byte_size(data)))
    end

    test "a message that was sent elsewhere never changes, also when its reader is killed", %{
      topic: topic,
      publisher: publisher,
      subscriber: subscriber
    } do
      published!(publisher, 7)
      test = self()

      {reader, monitor} =
        spawn_monitor(fn ->
          Subscriber.with_frame(subscriber, fn %{data: data} ->
            send(test, {:frame, data})
            Process.sleep(:infinity)
          end)
        end)

      assert_receive {:frame, data}
      assert held(topic) == 1
      Process.exit(reader, :kill)
      assert_receive {:DOWN, ^monitor, _, _, :killed}
      assert BB.Test.Eventually.eventually(fn -> held(topic) == 0 end)
      for n <- 10..20, do: published!(publisher, n)
      assert data == frame(7)
    end

    test "a function that raises releases the slot", %{
      topic: topic,
      publisher: publisher,
      subscriber: subscriber
    } do
      published!(publisher, 1)

      assert_raise RuntimeError, "on purpose", fn ->
        Subscriber.with_frame(subscriber, fn _ -> raise "on purpose" end)
      end

      assert held(topic) == 0
    end

    test "a short message is copied and holds nothing", %{
      topic: topic,
      publisher: publisher,
      subscriber: subscriber
    } do
      :ok = Publisher.publish(publisher, "short")

      assert {:ok, "short"} =
               Subscriber.with_frame(subscriber, fn %{data: data} ->
                 assert held(topic) == 0
                 data
               end)
    end

    test "three frames of a subscriber can be lent at a time", %{
      publisher: publisher,
      subscriber: subscriber
    } do
      nest = fn nest, depth ->
        :ok = Publisher.publish(publisher, frame(depth))
        Subscriber.with_frame(subscriber, fn _ -> nest.(nest, depth + 1) end)
      end

      assert {:ok, {:ok, {:ok, {:error, :too_many_leases}}}} = nest.(nest, 0)
      assert {:ok, 3} = Subscriber.with_frame(subscriber, & &1.sequence)
    end

    test "of a closed subscriber is an error", %{subscriber: subscriber} do
      :ok = Subscriber.close(subscriber)
      assert {:error, :closed} = Subscriber.with_frame(subscriber, &flunk(inspect(&1)))
    end

    test "outlives the subscriber while it runs", %{
      publisher: publisher,
      subscriber: subscriber
    } do
      published!(publisher, 5)

      assert {:ok, true} =
               Subscriber.with_frame(subscriber, fn %{data: data} ->
                 :ok = Subscriber.close(subscriber)
                 :ok = Publisher.close(publisher)
                 data == frame(5)
               end)
    end

    test "releases a dropped frame in time, also during a storm", %{
      topic: topic,
      publisher: publisher,
      subscriber: subscriber
    } do
      1..4
      |> Enum.map(fn _ ->
        Task.async(fn ->
          for _ <- 1..200 do
            Subscriber.with_frame(subscriber, fn %{data: <<n, rest::binary>>} ->
              if rem(n, 3) == 0, do: :erlang.garbage_collect()
              assert :binary.last(rest) == n
            end)
          end
        end)
      end)
      |> then(fn tasks ->
        for n <- 0..255, do: Publisher.publish(publisher, frame(n))
        Task.await_many(tasks, :infinity)
      end)

      assert held(topic) == 0
    end
  end

  describe "bad input" do
    test "an invalid topic name raises, and the error names what is valid" do
      for name <- ["", "a/b", "ä", String.duplicate("x", 201), :atom] do
        assert_raise ArgumentError, ~r/expected a topic's name of 1 to 200 characters/, fn ->
          Publisher.open(name)
        end
      end
    end

    test "invalid slots raise with the given value", %{topic: topic} do
      assert_raise BB.Options.ValidationError, ~r/:slot_count.*power of two.*got: 3/, fn ->
        Publisher.open(topic, slot_count: 3)
      end

      assert_raise BB.Options.ValidationError, ~r/:slot_size.*got: 20/, fn ->
        Publisher.open(topic, slot_size: 20)
      end

      assert_raise BB.Options.ValidationError, ~r/unknown options \[:size\]/, fn ->
        Publisher.open(topic, size: 20)
      end

      assert_raise ArgumentError, ~r/depth and max_message_size, got/, fn ->
        Publisher.open(topic, depth: 4)
      end

      assert_raise BB.Options.ValidationError, ~r/:active/, fn ->
        Subscriber.open(topic, active: :twice)
      end

      assert_raise BB.Options.ValidationError, ~r/:start/, fn ->
        Subscriber.open(topic, start: :end)
      end
    end

    test "a term that is no iodata raises, and the ring is unharmed", %{topic: topic} do
      publisher = open!(topic)
      %{ref: ref} = attached!(topic, active: true)
      assert_raise ArgumentError, fn -> Publisher.publish(publisher, [:atom]) end
      :ok = Publisher.publish(publisher, "fine")
      assert_receive {:bb_ring, ^ref, %Message{sequence: 0, data: "fine"}}
    end

    test "a file that is no ring is refused by name", %{topic: topic} do
      path = "/dev/shm/conduit_#{topic}"
      File.write!(path, String.duplicate("nonsense", 1000))
      assert {:error, {:not_a_ring, ^path, text}} = Ring.info(topic)
      assert is_binary(text)
    end
  end
end
