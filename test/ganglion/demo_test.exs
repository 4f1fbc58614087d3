defmodule Ganglion.DemoTest do
  use ExUnit.Case, async: true

  alias BB.Message
  alias BB.Message.Vision.TagDetections
  alias Ganglion.Demo.{Declaration, Observation, Options, Report}
  alias Ganglion.Robots.All

  doctest Ganglion.Json
  doctest Ganglion.Demo.Counter
  doctest Ganglion.Demo.Declaration
  doctest Ganglion.Demo.Latency
  doctest Ganglion.Demo.Options
  doctest Ganglion.Demo.RealBuses

  describe "the command line" do
    @describetag :tmp_dir

    test "relative paths are relative to the caller's folder", %{tmp_dir: dir} do
      File.write!(Path.join(dir, "walk.csv"), "")
      argv = ~w(--seconds 3 --imu walk.csv --frames . --json)
      expected = %Options{seconds: 3, imu: Path.join(dir, "walk.csv"), frames: dir, json: true}
      assert {:ok, ^expected} = Options.parse(argv, dir)
    end

    test "--real and --bus select the machine's own buses", %{tmp_dir: dir} do
      assert {:ok, %Options{real: true, bus: nil}} = Options.parse(~w(--real), dir)
      assert {:ok, %Options{bus: "i2c-7"}} = Options.parse(~w(--real --bus i2c-7), dir)
    end

    test "invalid arguments return a sentence with what was given and what is expected", %{
      tmp_dir: dir
    } do
      for {argv, words} <- [
            {~w(--bogus), ["--bogus", "--seconds N"]},
            {~w(extra), ["extra", "--seconds N"]},
            {~w(--seconds 0), ["from 1 up", "got: 0"]},
            {~w(--seconds soon), ["whole number", "got: soon"]},
            {~w(--robot none), ["ganglion, all", "got: none"]},
            {~w(--robot NoRobot), ["a robot's module", "got: NoRobot"]},
            {~w(--robot Enum), ["a robot's module", "got: Enum"]},
            {~w(--robot all --imu walk.csv), ["--imu", "add --robot ganglion"]},
            {~w(--bus i2c-7), ["--bus", "add --real"]},
            {~w(--real --bus), ["--bus", "nothing"]},
            {~w(--real --imu walk.csv), ["--imu", "--real"]},
            {~w(--imu), ["--imu", "nothing"]},
            {~w(--imu missing.csv), [Path.join(dir, "missing.csv")]},
            {~w(--frames missing), [Path.join(dir, "missing")]}
          ] do
        assert {:error, sentence} = Options.parse(argv, dir)
        for word <- words, do: assert(sentence =~ word)
      end
    end
  end

  test "shows any robot: the named one, or the caller's" do
    robot = a_robot()
    assert {:ok, %{robot: ^robot}} = Options.parse(["--robot", inspect(robot)], "/")
    assert {:ok, %{robot: ^robot}} = Options.parse([], "/", robot)
    assert {:ok, %{robot: Ganglion.Robots.All}} = Options.parse(~w(--robot all), "/", robot)
    assert {:error, sentence} = Options.parse(~w(--imu walk.csv), "/", robot)
    assert sentence =~ "add --robot ganglion"
  end

  describe "the declaration of a robot" do
    test "has its topics, the components that use them, and their outputs" do
      assert Declaration.topics(Ganglion.Robot) |> Enum.sort() == ~w(camera imu tags)
      assert Declaration.carriers(Ganglion.Robot) |> Enum.sort() == [:imu_outlet, :tags_inlet]

      assert Declaration.outputs(Ganglion.Robot) ==
               %{camera: "camera", imu_outlet: "imu", tags_inlet: "tags"}

      assert Declaration.vision?(Ganglion.Robot)
    end

    test "follows publishes, and leaves out outputs that are not declared" do
      robot = a_robot()
      assert Declaration.name(robot) == "stranger"
      assert Declaration.topics(robot) == ~w(scans map pose)
      assert Declaration.outputs(robot) == %{mapper: "map"}
      refute Declaration.vision?(robot)

      assert {[], [], %{}} =
               {Declaration.topics(All), Declaration.carriers(All), Declaration.outputs(All)}
    end
  end

  defp a_robot do
    BB.Test.Robot.create(
      quote do
        settings do
          name :stranger
        end

        sensors do
          sensor :mapper,
                 {BB.Sensor.NativeProcess,
                  program: "mapper", topics: [scans: "scans", map: "map"], publishes: [:map]}

          sensor :pilot,
                 {BB.Sensor.NativeProcess, program: "pilot", topics: [map: "map", pose: "pose"]}
        end
      end
    )
  end

  describe "the summary" do
    setup do
      second = 1_000_000_000
      imu = Message.new!(Message.Sensor.Contact, :bumper, pressed: true)

      tags =
        Message.new!(TagDetections, :camera,
          frame_sequence: 0,
          capture_time: 4 * second - 20_000_000,
          detections: []
        )

      before = %{topic: "camera", published: 100, readers: [], state: :live}
      reader = %{os_pid: 1, index: 0, lost: 3}

      observation =
        Observation.new([before], 0)
        |> Observation.message([:sensor, :base, :bumper], imu, 1 * second)
        |> Observation.message([:sensor, :base, :bumper], imu, 2 * second)
        |> Observation.message([:sensor, :base, :bumper], imu, 3 * second)
        |> Observation.message([:sensor, :tags], tags, 4 * second)
        |> Observation.topic(%{before | published: 130, readers: [reader]}, 3 * second)
        |> Observation.topic(
          %{before | published: 10, readers: [%{reader | os_pid: 2, lost: 1}]},
          4 * second
        )

      health = [
        %{
          name: :bumper,
          module: BB.Sensor.Mpu6050,
          path: [:base, :bumper],
          state: :up,
          restarts: 0,
          reason: nil,
          declared_hz: 1,
          error: nil
        },
        %{
          name: :camera,
          module: BB.Sensor.NativeProcess,
          path: [:camera],
          state: :backoff,
          restarts: 2,
          reason: {:exit_status, 1},
          declared_hz: nil,
          error: "the program ended with status 1"
        }
      ]

      view = %{
        observation: observation,
        health: health,
        carried: %{inlet: %{published: 1, lost: 0, malformed: 2}},
        processor: 0.123,
        name: "ganglion",
        outputs: %{camera: "camera"},
        vision?: true,
        seconds: 4.0,
        now: 4 * second,
        log: ["[info] a line"]
      }

      {:ok, view: view}
    end

    test "counts each sensor by its path or its ring topic, also a recreated one", %{
      view: view
    } do
      assert %{bumper: bumper, camera: camera} = Report.summary(view).sensors

      assert %{state: :up, published: 3, hz: 1.0, declared_hz: 1, restarts: 0, error: nil} =
               bumper

      assert %{state: :backoff, published: 40, restarts: 2, error: "the program" <> _} = camera
    end

    test "has frames, latency, and the losses of all readers of the ring", %{view: view} do
      assert %{vision: vision, ring: ring} = Report.summary(view)
      assert vision == %{frames: 1, detections: 0, p50_us: 20_000, p99_us: 20_000}
      assert ring == %{lost: 4, torn: 2}
    end

    test "of a robot that has published nothing is all zeros", %{view: view} do
      summary = Report.summary(%{view | observation: Observation.new([], 0), carried: %{}})
      assert %{state: :up, published: 0, hz: hz, restarts: 0} = summary.sensors.bumper
      assert hz == 0.0
      assert summary.cpu_percent == 12.3
      assert summary.vision == %{frames: 0, detections: 0, p50_us: nil, p99_us: nil}
      assert summary |> Ganglion.Json.encode() |> IO.iodata_to_binary() =~ ~s("p50_us":null)
    end

    test "the screen shows the last value of an unknown payload", %{view: view} do
      payload = %Message.Sensor.BatteryState{voltage: 12.0, percentage: 0.5}
      contact = Message.new!(Message.Sensor.Contact, :bumper, pressed: true)
      message = %{contact | payload: payload}

      observation =
        Observation.message(view.observation, [:sensor, :base, :bumper], message, view.now)

      screen = IO.iodata_to_binary(Report.screen(%{view | observation: observation}))
      assert screen =~ ~r/bumper +up .* capacity 0\.0/
    end

    test "the screen of a robot without a camera has no line about vision", %{view: view} do
      assert IO.iodata_to_binary(Report.screen(view)) =~ "vision:"
      refute IO.iodata_to_binary(Report.screen(%{view | vision?: false})) =~ "vision"
      refute IO.iodata_to_binary(Report.closing(%{view | vision?: false})) =~ "vision"
    end

    test "the screen shows states, reasons and the log", %{view: view} do
      screen = IO.iodata_to_binary(Report.screen(view))
      assert screen =~ ~r/bumper +up +1\.0 +1 +1000 ms/
      assert screen =~ ~r/camera +backoff.*\ncamera: the program ended with status 1/
      for line <- String.split(screen, "\n"), do: assert(String.length(line) <= 80)
      assert screen =~ "[info] a line"
    end
  end

  describe "bin/demo" do
    @demo Path.expand("../../bin/demo", __DIR__)

    test "prints its usage" do
      assert {text, 0} = System.cmd(@demo, ["--help"])

      for option <- ~w(--seconds --robot --real --bus --imu --frames --json),
          do: assert(text =~ option)
    end

    test "shows a robot by its name, with its sensors, and a summary" do
      assert {text, 0} = System.cmd(@demo, ~w(--seconds 2), stderr_to_stdout: true)
      assert text =~ ~r/^ganglion, \d+ s /m
      assert text =~ ~r/^imu +up /m
      assert text =~ ~r/^summary after /m
    end

    test "reports a missing bus of the machine in one sentence, with the remedy" do
      {text, status} =
        System.cmd(@demo, ~w(--real --bus i2c-of-nobody --seconds 1), stderr_to_stdout: true)

      assert status == 1
      assert [sentence] = for("demo: " <> sentence <- String.split(text, "\n"), do: sentence)
      assert sentence =~ "no bus /dev/i2c-of-nobody: enable it"
    end
  end
end
