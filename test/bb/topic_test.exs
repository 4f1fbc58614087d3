defmodule BB.TopicTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Mistake
  import BB.Test.Native
  import BB.Test.Robot

  alias BB.Handoff.{Encoding, Inlet, Outlet}
  alias BB.Sensor.NativeProcess
  alias BB.Test.Run

  doctest BB.Topic

  @imu BB.Message.new!(BB.Message.Sensor.Imu, :base,
         orientation: BB.Math.Quaternion.identity(),
         angular_velocity: BB.Math.Vec3.zero(),
         linear_acceleration: BB.Math.Vec3.zero()
       )

  # An outlet and an inlet on one topic: the inlet publishes the messages of the outlet.
  defp carrying(outlet, inlet, prefix \\ nil) do
    settings = if prefix, do: [topic_prefix: prefix], else: []

    create(
      quote do
        settings(unquote(settings))

        sensors do
          sensor :out, {Outlet, from: [:in], topic: unquote(outlet), encoding: Encoding.Imu}
          sensor :in, {Inlet, to: [:out], topic: unquote(inlet), encoding: Encoding.Imu}
        end
      end
    )
  end

  defp start(robot, opts \\ []) do
    start_supervised!(Supervisor.child_spec({robot, opts}, id: robot))
    eventually(fn -> Enum.all?([:out, :in], &(health(robot, &1).state == :up)) end)
    robot
  end

  defp assert_carries(robot) do
    {:ok, _} = BB.subscribe(robot, [:out])
    assert eventually(fn -> publish(robot) && received?() end)
  end

  defp publish(robot), do: BB.publish(robot, [:in], @imu) == :ok

  defp received? do
    receive do
      {:bb, [:out], _message} -> true
    after
      10 -> false
    end
  end

  defp live?(topic), do: match?({:ok, %{state: :live}}, BB.Ring.info(topic))

  test "the prefix of the settings goes before the names of outlets and inlets" do
    prefix = Run.unique("rover")
    robot = start(carrying("imu", "imu", prefix))
    assert BB.topic(robot, "imu") == "#{prefix}.imu"
    assert live?("#{prefix}.imu")
    assert_carries(robot)
  end

  test "that of the start goes before it" do
    [declared, given] = for label <- ~w(declared given), do: Run.unique(label)
    robot = start(carrying("imu", "imu", declared), topic_prefix: given)
    assert BB.topic(robot, "imu") == "#{given}.imu"
    assert live?("#{given}.imu")
    refute live?("#{declared}.imu")
    assert_carries(robot)

    stop_supervised!(robot)
    assert start(robot) |> BB.topic("imu") == "#{declared}.imu"
  end

  test "a name with a / before it is the same with and without a prefix" do
    topic = topic("shared")
    robot = start(carrying("/" <> topic, "/" <> topic, Run.unique("rover")))
    assert BB.topic(robot, "/" <> topic) == topic
    assert live?(topic)
    assert_carries(robot)
  end

  test "without a prefix names are as they are declared" do
    topic = topic("plain")
    robot = start(carrying(topic, "/" <> topic))
    assert BB.topic(robot, topic) == topic
    assert_carries(robot)
  end

  test "two robots that declare the same names do not meet" do
    robots =
      for label <- ~w(one two), do: start(carrying("imu", "imu"), topic_prefix: Run.unique(label))

    for robot <- robots, do: assert_carries(robot)
    for robot <- robots, do: assert(BB.Ring.info(BB.topic(robot, "imu")) |> elem(0) == :ok)
  end

  test "a native process is given its topics with the prefix, and absolute ones without the /" do
    prefix = Run.unique("rover")

    robot =
      create(
        quote do
          settings do
            topic_prefix unquote(prefix)
          end

          sensors do
            sensor :camera,
                   {NativeProcess,
                    program: "camera",
                    topics: [topic: "camera"],
                    publishes: [:topic],
                    args: ["--rate", "50"]},
                   max_silence: ~u(20 second)
          end
        end
      )

    start_supervised!(robot)
    assert eventually(fn -> live?("#{prefix}.camera") end)
    # It is stale unless it publishes there.
    assert health(robot, :camera).state == :up
  end

  describe "a name that is none" do
    test "with the prefix of the settings is told while the robot compiles" do
      long = String.duplicate("x", 190)

      for {topic, options} <- [
            {long, ~s(topics: [frames: "#{long}"])},
            {"cam 1", ~s(topics: [frames: "cam 1"])},
            {"a b", ~s(publishes: ["a b"])}
          ] do
        error =
          mistake("""
          sensors do
            sensor :camera, {BB.Sensor.NativeProcess, program: "camera", #{options}}
          end
          settings topic_prefix: "the_other_rover"
          """)

        assert error.path == [:sensors, :camera]
        assert error.reason =~ "sensor :camera: expected a topic's name of 1 to 200 characters"
        assert error.reason =~ ~s(got: "the_other_rover.#{topic}", with the robot's topic_prefix)
      end
    end

    test "with the prefix of the start is told then, and nothing is started" do
      robot = carrying(String.duplicate("x", 190), "/tags")
      assert {:error, error} = robot.start_link(topic_prefix: "the_other_rover")
      sentence = Exception.message(error)
      assert sentence =~ "1 to 200 characters"
      assert sentence =~ "the_other_rover.xxx"
      assert sentence =~ "(in options [:out])"
      assert Process.whereis(robot) == nil
    end

    test "is an absolute one with a / inside" do
      assert_raise BB.Dsl.Error, ~r/sensor :out: .*got: "a\/b"/, fn ->
        carrying("/a/b", "/tags")
      end

      error = mistake(~s(sensors do
        sensor :x, {BB.Sensor.NativeProcess, program: "x", topics: [frames: "/dev/video0"]}
      end))
      assert error.reason =~ ~s(without / and control characters, got: "dev/video0")
    end
  end

  describe "a prefix" do
    test "that no topic's name can begin with is refused, in the settings and at the start" do
      for wrong <- ["", "a/b", "a b", :rover, String.duplicate("x", 201)] do
        error = mistake("settings topic_prefix: #{inspect(wrong)}")
        assert error.reason =~ ~s(expected text such as "rover")
        assert error.reason =~ "got: #{inspect(wrong)}"

        assert {:error, error} = carrying("a", "/b").start_link(topic_prefix: wrong)
        assert Exception.message(error) =~ "topic_prefix"
      end
    end

    test "of a robot that runs stays when somebody starts it again" do
      prefix = Run.unique("rover")
      robot = start(carrying("imu", "imu"), topic_prefix: prefix)
      assert {:error, {:already_started, _pid}} = robot.start_link(topic_prefix: "another")
      assert BB.topic(robot, "imu") == "#{prefix}.imu"
    end
  end

  test "BB.topic/2 raises for a name that is none" do
    robot = carrying("a", "/b", "rover")
    assert_raise ArgumentError, ~r/of 1 to 200 characters/, fn -> BB.topic(robot, "a b") end
  end
end
