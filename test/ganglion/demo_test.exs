defmodule Ganglion.DemoTest do
  use ExUnit.Case, async: true

  alias BB.Message
  alias BB.Message.Vision.TagDetections
  alias Ganglion.Demo.{Observation, Options, Report}

  doctest Ganglion.Json
  doctest Ganglion.Demo.Counter
  doctest Ganglion.Demo.Latency
  doctest Ganglion.Demo.RealBuses

  describe "the command line" do
    @describetag :tmp_dir

    test "relative paths count from where the caller stands", %{tmp_dir: dir} do
      File.write!(Path.join(dir, "walk.csv"), "")
      argv = ~w(--seconds 3 --imu walk.csv --frames . --json)
      expected = %Options{seconds: 3, imu: Path.join(dir, "walk.csv"), frames: dir, json: true}
      assert {:ok, ^expected} = Options.parse(argv, dir)
    end

    test "the machine's own buses are asked for, and by which name", %{tmp_dir: dir} do
      assert {:ok, %Options{real: true, bus: nil}} = Options.parse(~w(--real), dir)
      assert {:ok, %Options{bus: "i2c-7"}} = Options.parse(~w(--real --bus i2c-7), dir)
    end

    test "a mistake is a sentence that says what was given and what is accepted", %{tmp_dir: dir} do
      for {argv, words} <- [
            {~w(--bogus), ["--bogus", "--seconds N"]},
            {~w(extra), ["extra", "--seconds N"]},
            {~w(--seconds 0), ["from 1 up", "got: 0"]},
            {~w(--seconds soon), ["whole number", "got: soon"]},
            {~w(--robot none), ["ganglion or all", "got: none"]},
            {~w(--robot all --imu walk.csv), ["--imu", "ganglion alone"]},
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
        topic_of: &if(&1 == :camera, do: "camera"),
        seconds: 4.0,
        now: 4 * second,
        log: ["[info] a line"]
      }

      {:ok, view: view}
    end

    test "counts each sensor by its path, or by its ring topic, also when that was made anew", %{
      view: view
    } do
      assert %{bumper: bumper, camera: camera} = Report.summary(view).sensors

      assert %{state: :up, published: 3, hz: 1.0, declared_hz: 1, restarts: 0, error: nil} =
               bumper

      assert %{state: :backoff, published: 40, restarts: 2, error: "the program" <> _} = camera
    end

    test "has frames, latency, and what the ring lost for all its readers", %{view: view} do
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

    test "tells how it is used" do
      assert {text, 0} = System.cmd(@demo, ["--help"])

      for option <- ~w(--seconds --robot --real --bus --imu --frames --json),
          do: assert(text =~ option)
    end

    test "says in one sentence that a bus of the machine is not there, and what to do" do
      {text, status} =
        System.cmd(@demo, ~w(--real --bus i2c-of-nobody --seconds 1), stderr_to_stdout: true)

      assert status == 1
      assert [sentence] = for("demo: " <> sentence <- String.split(text, "\n"), do: sentence)
      assert sentence =~ "there is no bus /dev/i2c-of-nobody: enable it"
    end
  end
end
