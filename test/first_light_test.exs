defmodule FirstLightTest do
  @moduledoc """
  The main task, end to end: the simulated chip, the ring, the camera and the detector that ship.
  """
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Native
  import BB.Test.Robot

  alias BB.Bus.Sim
  alias BB.Message.Sensor.{Imu, Status}
  alias BB.Message.Vision.TagDetections

  @imu [:sensor, :base_link, :imu]
  @tags [:sensor, :camera, :tags]
  @address 0x68

  # The parts of the shipped robot with a bus and topics of their own, so that tests can run
  # concurrently.
  defp start_robot!(opts) do
    bus = "i2c-test-#{System.unique_integer([:positive])}"

    devices =
      if opts[:imu] == :absent, do: %{}, else: %{@address => {Sim.Mpu6050, source: :motion}}

    start_supervised!({Sim, buses: %{bus => [devices: devices]}})
    topics = %{imu: topic("imu"), camera: topic("camera"), tags: topic("tags")}
    robot = create(declaration(bus, topics, opts[:camera_args] || []))
    start_supervised!(robot)
    Map.merge(topics, %{robot: robot, bus: bus})
  end

  defp declaration(bus, topics, camera_args) do
    quote do
      sensors do
        sensor :imu_outlet,
               {BB.Handoff.Outlet,
                from: unquote(@imu), topic: unquote(topics.imu), encoding: BB.Handoff.Encoding.Imu}

        sensor :inlet,
               {BB.Handoff.Inlet,
                topic: unquote(topics.tags),
                encoding: BB.Handoff.Encoding.TagDetections,
                to: unquote(@tags)}

        sensor :camera,
               {BB.Sensor.NativeProcess,
                program: "camera",
                topics: [topic: unquote(topics.camera)],
                args: unquote(camera_args)}

        sensor :tags,
               {BB.Sensor.NativeProcess,
                program: "vision_tags",
                topics: [
                  frames: unquote(topics.camera),
                  imu: unquote(topics.imu),
                  detections: unquote(topics.tags)
                ]}
      end

      topology do
        link :base_link do
          sensor :imu, {BB.Sensor.Mpu6050, bus: unquote(bus), rate: 100},
            max_silence: BB.Unit.new!(1000, :millisecond)
        end
      end
    end
  end

  defp next_tags do
    assert_receive {:bb, @tags, %BB.Message{payload: %TagDetections{} = found}}
    found
  end

  describe "the photographs" do
    @folder shared_data("tags")
    unless @folder, do: @tag(skip: "../shared/data is not here")

    test "all tags arrive on the pubsub, each corner within 0.2 px of the reference" do
      %{robot: robot} = start_robot!(camera_args: ["--frames", @folder, "--rate", "5"])
      {:ok, _} = BB.subscribe(robot, @tags)

      found =
        for _ <- 1..4, into: %{} do
          assert_receive {:bb, @tags, %BB.Message{payload: %TagDetections{} = found}}
          # The camera shows the two photographs in the order of their names.
          {rem(found.camera_frame_id, 2), found.detections}
        end

      for {file, index, count} <- [{"swarmathon_1.txt", 0, 12}, {"swarmathon_2.txt", 1, 10}] do
        reference = reference(file)
        detections = Map.fetch!(found, index)
        assert {length(reference), length(detections)} == {count, count}

        for {id, corners} <- reference do
          assert Enum.any?(
                   detections,
                   &(&1.id == id and worst_corner(&1.corners, corners) <= 0.2)
                 ),
                 "#{file}: no detection has the corners #{inspect(corners)}"
        end
      end
    end

    # One detection a line: id, (x y), (x y), (x y), (x y)
    defp reference(file) do
      for line <- "tags" |> shared_data() |> Path.join(file) |> File.stream!() do
        [id | corners] = Regex.scan(~r/-?[\d.]+/, line) |> Enum.map(&hd/1)

        {String.to_integer(id),
         corners
         |> Enum.map(&String.to_float/1)
         |> Enum.chunk_every(2)
         |> Enum.map(&List.to_tuple/1)}
      end
    end

    defp worst_corner(corners, reference) do
      corners
      |> Enum.zip(reference)
      |> Enum.map(fn {{x, y}, {rx, ry}} -> :math.sqrt((x - rx) ** 2 + (y - ry) ** 2) end)
      |> Enum.max()
    end
  end

  test "the rendered scene's tags arrive with the angular velocity of the IMU at the capture" do
    before_ns = System.monotonic_time(:nanosecond)
    %{robot: robot} = start_robot!(camera_args: ["--rate", "20"])
    {:ok, _} = BB.subscribe(robot, @tags)

    found =
      eventually(fn ->
        assert_receive {:bb, @tags, %BB.Message{payload: %TagDetections{} = found}}
        found.angular_speed && length(found.detections) >= 3 && found
      end)

    assert {found.image_width, found.image_height} == {640, 480}
    assert found.capture_time in before_ns..System.monotonic_time(:nanosecond)
  end

  test "kill -9 of the vision process: it restarts, and no other sensor is affected" do
    %{robot: robot, tags: tags} = start_robot!(camera_args: ["--rate", "20"])
    {:ok, _} = BB.subscribe(robot, @tags)
    {:ok, _} = BB.subscribe(robot, [:sensor_status])
    next_tags()
    eventually(fn -> Enum.all?(BB.Sensor.health(robot), &(&1.state == :up)) end)
    flush_status()
    others = [:imu, :camera, :imu_outlet, :inlet]
    pids = Map.new(others, &{&1, BB.Process.whereis(robot, &1)})
    {:ok, %{published: before}} = BB.Handoff.stats(robot, :imu_outlet)

    [vision] = processes("vision_tags", tags)
    kill_9(vision)
    assert_receive {:bb, [:sensor_status, :tags], %{payload: %Status{state: :backoff}}}

    assert_receive {:bb, [:sensor_status, :tags], %{payload: %Status{state: :up, restarts: 1}}}

    # The new process takes over in place, and its detections arrive.
    {:ok, %{published: taken_over}} = eventually(fn -> in_epoch(tags, 1) end)
    eventually(fn -> match?({:ok, %{published: n}} when n > taken_over, BB.Ring.info(tags)) end)
    {:ok, %{published: arrived}} = BB.Handoff.stats(robot, :inlet)

    eventually(fn ->
      match?({:ok, %{published: n}} when n > arrived, BB.Handoff.stats(robot, :inlet))
    end)

    assert pids == Map.new(others, &{&1, BB.Process.whereis(robot, &1)})

    for [_ | _] = path <- [[:base_link, :imu], [:camera], [:imu_outlet], [:inlet]] do
      refute_received {:bb, [:sensor_status | ^path], _}
    end

    {:ok, %{published: now}} = BB.Handoff.stats(robot, :imu_outlet)
    assert now > before
  end

  defp in_epoch(topic, epoch) do
    info = BB.Ring.info(topic)
    if match?({:ok, %{epoch: ^epoch, state: :live}}, info), do: info
  end

  defp flush_status do
    receive do
      {:bb, [:sensor_status | _], _} -> flush_status()
    after
      0 -> :ok
    end
  end

  test "unplug and replug the IMU: backoff, then up; the tags never stop" do
    %{robot: robot, bus: bus} = start_robot!(camera_args: ["--rate", "20"])
    {:ok, _} = BB.subscribe(robot, [:sensor_status, :base_link, :imu])
    {:ok, _} = BB.subscribe(robot, @tags)
    next_tags()
    eventually(fn -> health(robot, :imu).state == :up end)
    flush_status()

    :ok = Sim.unplug(bus, @address)
    assert_receive {:bb, _, %{payload: %Status{state: :backoff}}}
    for _ <- 1..20, do: next_tags()
    refute_received {:bb, _, %{payload: %Status{state: :up}}}

    :ok = Sim.replug(bus, @address)
    assert_receive {:bb, _, %{payload: %Status{state: :up}}}
    {:ok, _} = BB.subscribe(robot, @imu)
    assert_receive {:bb, @imu, %{payload: %Imu{}}}
    next_tags()
    assert health(robot, :tags).restarts == 0
  end

  test "an IMU that is absent at boot: the robot starts, and the IMU publishes when it is plugged in" do
    %{robot: robot, bus: bus} = start_robot!(imu: :absent)
    {:ok, _} = BB.subscribe(robot, @imu)
    eventually(fn -> health(robot, :imu).state == :backoff end)
    eventually(fn -> health(robot, :camera).state == :up end)
    :ok = Sim.plug(bus, @address, {Sim.Mpu6050, source: :motion})
    assert_receive {:bb, @imu, %{payload: %Imu{}}}
  end

  describe "kill -9 of the BEAM" do
    test "leaves no native process, and the next BEAM takes the rings over" do
      topics = [frames, _own] = [topic("camera"), topic("own")]
      beam = start_beam(topics)
      natives = eventually(fn -> native_processes(frames) end)
      before = eventually(fn -> published(topics) end)
      kill_9(beam.os_pid)
      eventually(fn -> not Enum.any?(natives, &running?/1) end)

      next = start_beam(topics)
      eventually(fn -> native_processes(frames) end)
      [_, own] = eventually(fn -> published(topics, Enum.map(before, & &1.published)) end)
      assert own.epoch == 1
      kill_9(next.os_pid)
      eventually(fn -> native_processes(frames) == nil end)
    end

    # The camera and its guard, once both run.
    defp native_processes(topic) do
      pids = processes("camera", topic) ++ processes("process_guard", topic)
      if length(pids) == 2, do: pids
    end

    # The topics, once each is live and has more messages than the given number.
    defp published(topics, more_than \\ [0, 0]) do
      infos =
        for topic <- topics, {:ok, %{state: :live} = info} <- [BB.Ring.info(topic)], do: info

      [_, own_before] = more_than

      if match?([%{published: n}, %{published: m}] when n > 0 and m > own_before, infos),
        do: infos
    end

    # Another BEAM, with a robot with a camera, and a publisher of its own.
    defp start_beam([frames, own]) do
      code = """
      defmodule OtherBeam do
        use BB
        sensors do
          sensor :camera, {BB.Sensor.NativeProcess, program: "camera", topics: [topic: "#{frames}"]}
        end
      end
      {:ok, _} = Application.ensure_all_started(:ganglion)
      {:ok, _} = OtherBeam.start_link()
      {:ok, publisher} = BB.Ring.Publisher.open("#{own}")
      Enum.each(Stream.cycle([:ok]), fn ok -> ^ok = BB.Ring.Publisher.publish(publisher, "alive") && Process.sleep(1) end)
      """

      ebin = Path.wildcard(Path.join(Mix.Project.build_path(), "lib/*/ebin"))
      args = Enum.flat_map(ebin, &["-pa", &1]) ++ ["-e", code]

      port =
        Port.open({:spawn_executable, System.find_executable("elixir")}, [
          :binary,
          :stderr_to_stdout,
          args: args
        ])

      {:os_pid, os_pid} = Port.info(port, :os_pid)
      on_exit(fn -> end_by_force(os_pid) end)
      %{port: port, os_pid: os_pid}
    end
  end
end
