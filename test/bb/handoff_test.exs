defmodule BB.HandoffTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Native
  import BB.Test.Robot
  import ExUnit.CaptureLog

  alias BB.Handoff.Encoding
  alias BB.Math.{Quaternion, Vec3}
  alias BB.Message.Sensor.{Imu, Range}
  alias BB.Message.Vision.TagDetections
  alias BB.Ring.{Message, Publisher, Subscriber}
  alias BB.Test.Vectors

  doctest BB.Handoff.Content

  defmodule Large do
    @moduledoc "Messages that are lent, since they are too large to be copied."
    @behaviour BB.Handoff.Encoding
    def content, do: "test/large"
    def payload, do: BB.Message.Sensor.Imu
    def encode(_message), do: :binary.copy(<<7>>, 70_000)
  end

  @path [:sensor, :base_link, :imu]

  defp outlet_robot(topic, opts \\ []) do
    opts =
      [from: [:sensor, :base_link], topic: topic, encoding: Encoding.Imu] |> Keyword.merge(opts)

    create(
      quote do
        sensors do
          sensor :outlet, {BB.Handoff.Outlet, unquote(opts)}
        end
      end
    )
  end

  defp inlet_robot(topic, opts \\ []) do
    opts = [topic: topic, encoding: Encoding.TagDetections] |> Keyword.merge(opts)

    create(
      quote do
        sensors do
          sensor :inlet, {BB.Handoff.Inlet, unquote(opts)}
        end
      end
    )
  end

  defp start_up!(robot, name) do
    start_supervised!(robot)
    eventually(fn -> health(robot, name).state == :up end)
    robot
  end

  defp imu(x) do
    BB.Message.new!(Imu, :imu,
      orientation: Quaternion.identity(),
      angular_velocity: Vec3.new(x, 0.0, 0.0),
      linear_acceleration: Vec3.zero()
    )
  end

  describe "an outlet" do
    test "carries a path and all below it into its topic, in order, with the encoding's name" do
      topic = topic()
      robot = start_up!(outlet_robot(topic), :outlet)
      {:ok, %{ref: ref}} = Subscriber.open(topic, active: true)
      for n <- 1..5, do: BB.publish(robot, @path, imu(n / 1))

      for n <- 1..5 do
        x = n / 1
        assert_receive {:bb_ring, ^ref, %Message{data: data, lost: 0}}
        assert {:ok, %{payload: %Imu{angular_velocity: %{x: ^x}}}} = Encoding.Imu.decode(data)
      end

      assert {:ok, %{published: 5, too_large: 0, held: 0}} = BB.Handoff.stats(robot, :outlet)
    end

    test "whose topic's file is removed runs on, and shows that in its health" do
      topic = topic()
      robot = start_up!(outlet_robot(topic), :outlet)
      %{pid: pid} = health(robot, :outlet)
      file = Path.join(System.get_env("CONDUIT_RING_DIR", "/dev/shm"), "conduit_" <> topic)

      assert capture_log(fn ->
               File.rm!(file)
               eventually(fn -> health(robot, :outlet).last_error == {:file_renewed, topic} end)
             end) =~ "the file of the topic #{topic} was removed, and has been made again"

      assert %{state: :up, pid: ^pid, restarts: 0, reason: nil, error: error} =
               health(robot, :outlet)

      assert error =~ topic and error =~ "made again"
    end

    test "shows in its health a process that holds a slot for longer than a lap" do
      topic = topic()

      robot =
        start_up!(outlet_robot(topic, slot_count: 4, slot_size: 80_000, encoding: Large), :outlet)

      {:ok, ring} = Subscriber.open(topic)
      test = self()

      carry = fn -> BB.publish(robot, @path, imu(1.0)) end
      carry.()
      # The first lease of a subscription may have to be a copy.
      eventually(fn -> Subscriber.with_frame(ring, fn _frame -> :ok end) == {:ok, :ok} end)

      carry.()
      hold = fn -> Subscriber.with_frame(ring, fn _frame -> held(test) end) end
      holder = Task.async(fn -> eventually(fn -> hold.() != {:error, :empty} end) end)
      assert_receive {:held, held}, 30_000

      own = String.to_integer(System.pid())

      assert capture_log(fn ->
               eventually(fn ->
                 for _ <- 1..8, do: carry.()
                 health(robot, :outlet).last_error == {:held, topic, [own]}
               end)
             end) =~ "process #{own} held messages of the topic #{topic}"

      send(held, :let_go)
      Task.await(holder, :infinity)
      assert %{state: :up, restarts: 0, error: error} = health(robot, :outlet)
      assert error =~ "process #{own}"
      assert error =~ topic
    end

    defp held(test) do
      send(test, {:held, self()})
      receive do: (:let_go -> :ok)
    end

    test "ignores messages of other payloads" do
      topic = topic()
      robot = start_up!(outlet_robot(topic), :outlet)

      range = [
        radiation_type: :infrared,
        field_of_view: 0.1,
        min_range: 0.0,
        max_range: 1.0,
        range: 0.5
      ]

      BB.publish(robot, @path, BB.Message.new!(Range, :front, range))
      BB.publish(robot, @path, imu(1.0))

      eventually(fn ->
        BB.Handoff.stats(robot, :outlet) == {:ok, %{published: 1, too_large: 0, held: 0}}
      end)
    end

    test "counts and logs a message that does not fit, and runs on" do
      topic = topic()

      log =
        capture_log(fn ->
          robot = start_up!(outlet_robot(topic, slot_size: 128), :outlet)
          for n <- 1..3, do: BB.publish(robot, @path, imu(n / 1))

          eventually(fn ->
            BB.Handoff.stats(robot, :outlet) == {:ok, %{published: 0, too_large: 3, held: 0}}
          end)
        end)

      assert [_before, _after] = String.split(log, "longer than the topic's slots")
    end

    test "whose topic has a live publisher is in backoff, and is up after that publisher closes" do
      topic = topic()
      {:ok, publisher} = Publisher.open(topic)
      robot = outlet_robot(topic)
      start_supervised!(robot)

      assert %{reason: reason} =
               eventually(fn -> (h = health(robot, :outlet)).state == :backoff && h end)

      assert inspect(reason) =~ "publisher_alive"
      :ok = Publisher.close(publisher)
      eventually(fn -> health(robot, :outlet).state == :up end)
    end

    test "that is killed continues in place: its readers lose no published message" do
      topic = topic()
      robot = start_up!(outlet_robot(topic), :outlet)
      {:ok, %{ref: ref}} = Subscriber.open(topic, active: true)
      BB.publish(robot, @path, imu(1.0))
      assert_receive {:bb_ring, ^ref, %Message{sequence: 0}}
      robot |> BB.Process.whereis(:outlet) |> Process.exit(:kill)

      eventually(fn ->
        health(robot, :outlet).restarts == 1 and health(robot, :outlet).state == :up
      end)

      BB.publish(robot, @path, imu(2.0))
      assert_receive {:bb_ring, ^ref, %Message{sequence: 1, lost: 0}}
    end

    test "that stops ends its topic" do
      topic = topic()
      robot = start_up!(outlet_robot(topic), :outlet)
      assert {:ok, %{state: :live}} = BB.Ring.info(topic)
      stop_supervised!(robot)
      assert {:error, {:no_topic, _}} = BB.Ring.info(topic)
    end
  end

  describe "an inlet" do
    test "carries a topic onto its own path" do
      topic = topic()
      robot = start_up!(inlet_robot(topic), :inlet)
      {:ok, _} = BB.subscribe(robot, [:sensor, :inlet])
      publish_vectors(topic, 1)

      assert_receive {:bb, [:sensor, :inlet],
                      %{payload: %TagDetections{detections: [_, _]}, robot: ^robot}}
    end

    test "or onto the path of its option `to:`" do
      topic = topic()
      robot = start_up!(inlet_robot(topic, to: [:sensor, :camera, :tags]), :inlet)
      {:ok, _} = BB.subscribe(robot, [:sensor, :camera])
      publish_vectors(topic, 1)
      assert_receive {:bb, [:sensor, :camera, :tags], %{payload: %TagDetections{}}}
    end

    test "returns its credits: many more messages than its credits all arrive" do
      topic = topic()
      robot = start_up!(inlet_robot(topic, credits: 3), :inlet)
      {:ok, _} = BB.subscribe(robot, [:sensor])
      publish_vectors(topic, 100)
      for _ <- 1..100, do: assert_receive({:bb, _, %{payload: %TagDetections{}}})
      assert {:ok, %{published: 100, lost: 0, malformed: 0}} = BB.Handoff.stats(robot, :inlet)
    end

    test "counts messages that do not decode, logs the first in a row, and runs on" do
      topic = topic()

      log =
        capture_log(fn ->
          robot = start_up!(inlet_robot(topic), :inlet)
          {:ok, _} = BB.subscribe(robot, [:sensor])
          {:ok, publisher} = open_read(topic)
          for _ <- 1..3, do: :ok = Publisher.publish(publisher, "nonsense")
          :ok = Publisher.publish(publisher, Vectors.read!("tags"))
          assert_receive {:bb, _, %{payload: %TagDetections{}}}
          assert {:ok, %{published: 1, malformed: 3}} = BB.Handoff.stats(robot, :inlet)
        end)

      assert [_before, _after] = String.split(log, "does not decode")
    end
  end

  describe "max_silence" do
    @seconds BB.Unit.new!(2, :second)

    defp guarded_robot(module, opts, max_silence) do
      create(
        quote do
          sensors do
            sensor :carrier, {unquote(module), unquote(opts)},
              required: true,
              max_silence: unquote(Macro.escape(max_silence))
          end
        end
      )
    end

    defp outlet(topic), do: [from: [:sensor, :base_link], topic: topic, encoding: Encoding.Imu]

    defp inlet(topic),
      do: [topic: topic, encoding: Encoding.TagDetections, to: [:sensor, :camera, :tags]]

    defp carries(BB.Handoff.Outlet, topic) do
      robot = guarded_robot(BB.Handoff.Outlet, outlet(topic), @seconds)
      {robot, fn -> BB.publish(robot, @path, imu(1.0)) end}
    end

    defp carries(BB.Handoff.Inlet, topic) do
      robot = guarded_robot(BB.Handoff.Inlet, inlet(topic), @seconds)
      {:ok, publisher} = Publisher.open(topic, content: Encoding.TagDetections.content())
      {robot, fn -> :ok = Publisher.publish(publisher, Vectors.read!("tags")) end}
    end

    @stretch_ms 5_000
    @pause_ms 500

    # The messages that it had published before and after more than twice its max_silence, or
    # `nil` when this process was delayed meanwhile.
    defp carried_without_pause(robot, carry) do
      carry.()
      eventually(fn -> health(robot, :carrier).state == :up end, 30_000)
      forget_statuses()
      {:ok, %{published: before}} = BB.Handoff.stats(robot, :carrier)
      carried? = carry_on(carry, now_ms() + @stretch_ms)
      {:ok, %{published: count}} = BB.Handoff.stats(robot, :carrier)
      if carried?, do: {before, count}
    end

    defp carry_on(carry, until_ms) do
      began_ms = now_ms()
      carry.()
      Process.sleep(5)
      paused? = now_ms() - began_ms > @pause_ms
      if paused? or now_ms() > until_ms, do: not paused?, else: carry_on(carry, until_ms)
    end

    defp forget_statuses do
      receive do
        {:bb, _path, %{payload: %BB.Message.Sensor.Status{}}} -> forget_statuses()
      after
        0 -> :ok
      end
    end

    defp now_ms, do: System.monotonic_time(:millisecond)

    for module <- [BB.Handoff.Outlet, BB.Handoff.Inlet] do
      test "of an #{module |> Module.split() |> List.last()} counts the messages that it carries" do
        {robot, carry} = carries(unquote(module), topic())
        start_supervised!(robot)
        {:ok, _} = BB.subscribe(robot, [:sensor_status, :carrier], replay: true)
        assert_receive {:bb, _, %{payload: %{state: :stale, reason: {:silent, 2_000}}}}, 30_000

        eventually(
          fn ->
            carry.()
            health(robot, :carrier).state == :up
          end,
          30_000
        )

        assert_receive {:bb, _, %{payload: %{state: :up, restarts: 0}}}, 30_000

        # It stays up while it carries messages.
        {before, count} = eventually(fn -> carried_without_pause(robot, carry) end, 300_000)
        assert count > before
        refute_received {:bb, _, %{payload: %{state: :stale}}}
        assert_receive {:bb, _, %{payload: %{state: :stale}}}, 30_000
      end
    end

    test "of an outlet without a message to carry passes" do
      robot = guarded_robot(BB.Handoff.Outlet, outlet(topic()), @seconds)
      start_supervised!(robot)

      eventually(
        fn ->
          range = [radiation_type: :infrared, field_of_view: 0.1, min_range: 0.0, max_range: 1.0]
          BB.publish(robot, @path, BB.Message.new!(Range, :front, range ++ [range: 0.5]))
          health(robot, :carrier).state == :stale
        end,
        30_000
      )
    end
  end

  describe "an inlet whose topic has another content than its encoding" do
    @scan "sensor_msgs/msg/LaserScan"

    # A message that decodes, so that only the tag prevents its publication.
    defp publish_until(publisher, fun) do
      eventually(
        fn ->
          _ = Publisher.publish(publisher, Vectors.read!("tags"))
          fun.()
        end,
        30_000
      )
    end

    defp down(robot) do
      eventually(fn -> (h = health(robot, :inlet)).state == :backoff && h.reason && h end, 30_000)
    end

    test "is down, names the content, and publishes nothing" do
      for {content, reason, words} <- [
            {@scan, {:other_content, @scan}, "the topic has messages of #{@scan}"},
            {"conduit/frame", {:other_content, "conduit/frame"}, "conduit/frame"},
            {"my_msgs/msg/Own", {:other_content, BB.Ring.content_tag("my_msgs/msg/Own")},
             "content tag 0x"},
            {nil, {:other_content, :untagged}, "`untagged: true`"}
          ] do
        topic = topic()
        {:ok, publisher} = Publisher.open(topic, if(content, do: [content: content], else: []))
        robot = inlet_robot(topic)
        start_supervised!(robot)
        {:ok, _} = BB.subscribe(robot, [:sensor])
        assert %{reason: ^reason, error: error} = down(robot)
        assert error =~ words
        # It is restarted several times, while messages are published.
        publish_until(publisher, fn -> health(robot, :inlet).restarts >= 2 end)
        refute_received {:bb, [:sensor | _], _}
        :ok = stop_supervised!(robot)
        Publisher.close(publisher)
      end
    end

    test "is up when the topic has the expected content" do
      topic = topic()
      {:ok, other} = Publisher.open(topic, content: @scan)
      robot = inlet_robot(topic)
      start_supervised!(robot)
      {:ok, _} = BB.subscribe(robot, [:sensor])
      down(robot)
      :ok = Publisher.close(other)
      {:ok, publisher} = Publisher.open(topic, content: Encoding.TagDetections.content())

      publish_until(publisher, fn ->
        published?(robot)
      end)

      assert health(robot, :inlet).state == :up
    end

    test "detects a later publisher, and one that takes the topic over" do
      for close? <- [true, false] do
        topic = topic()
        robot = start_up!(inlet_robot(topic), :inlet)
        {:ok, _} = BB.subscribe(robot, [:sensor])

        # The topic does not exist yet, and has detections at first.
        owner = BB.Test.Actor.start()
        {:ok, first} = BB.Test.Actor.run(owner, fn -> open_read(topic) end)

        publish_until(first, fn ->
          published?(robot)
        end)

        assert_receive {:bb, _, %{payload: %TagDetections{}}}, 30_000

        # Then another publisher opens it, after the first has closed or died.
        if close?, do: Publisher.close(first)
        BB.Test.Actor.stop(owner)
        {:ok, second} = eventually(fn -> other_publisher(topic) end, 30_000)
        assert %{reason: {:other_content, @scan}} = down(robot)
        forget_sensor()
        publish_until(second, fn -> health(robot, :inlet).restarts >= 2 end)
        refute_received {:bb, [:sensor | _], _}
        :ok = stop_supervised!(robot)
        Publisher.close(second)
      end
    end

    test "accepts a topic without a content tag if its options say so, and no other" do
      topic = topic()
      robot = start_up!(inlet_robot(topic, untagged: true), :inlet)
      {:ok, _} = BB.subscribe(robot, [:sensor])
      {:ok, publisher} = open_read(topic, content: nil)
      :ok = Publisher.publish(publisher, Vectors.read!("tags"))
      assert_receive {:bb, _, %{payload: %TagDetections{}}}, 30_000
      :ok = Publisher.close(publisher)
      {:ok, _other} = Publisher.open(topic, content: @scan)
      assert %{reason: {:other_content, @scan}} = down(robot)
    end

    defp published?(robot),
      do: match?({:ok, %{published: n}} when n > 0, BB.Handoff.stats(robot, :inlet))

    defp other_publisher(topic) do
      with {:error, _still_there} <- Publisher.open(topic, content: @scan), do: nil
    end

    defp forget_sensor do
      receive do
        {:bb, [:sensor | _], _} -> forget_sensor()
      after
        0 -> :ok
      end
    end
  end

  test "the counters of an outlet that is down are an error" do
    topic = topic()
    {:ok, _publisher} = Publisher.open(topic)
    robot = outlet_robot(topic)
    start_supervised!(robot)
    eventually(fn -> health(robot, :outlet).state == :backoff end)
    assert {:error, :not_running} = BB.Handoff.stats(robot, :outlet)
  end

  test "wrong options fail the start of the robot, and the error names what is accepted" do
    for opts <- [[encoding: NoEncoding], [from: "imu"], [slot_count: 3]] do
      robot = outlet_robot("t", opts)
      assert {:error, %BB.Options.ValidationError{} = error} = robot.start_link()
      assert Exception.message(error) =~ to_string(opts |> Keyword.keys() |> hd())
    end
  end

  test "a topic name that is not allowed fails the start of the robot" do
    assert {:error, %BB.Options.ValidationError{} = error} = outlet_robot("a/b").start_link()
    assert Exception.message(error) =~ "A-Z a-z 0-9 _ . -"
  end

  defp open_read(topic, opts \\ []) do
    opts = [slot_count: 128, content: Encoding.TagDetections.content()] |> Keyword.merge(opts)
    {:ok, publisher} = Publisher.open(topic, Enum.filter(opts, &elem(&1, 1)))
    eventually(fn -> match?({:ok, %{readers: [_]}}, BB.Ring.info(topic)) end)
    {:ok, publisher}
  end

  defp publish_vectors(topic, count) do
    {:ok, publisher} = open_read(topic)
    for _ <- 1..count, do: :ok = Publisher.publish(publisher, Vectors.read!("tags"))
  end
end
