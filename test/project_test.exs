defmodule ProjectTest do
  @moduledoc """
  Tests what a project inherits that depends on Ganglion by path and by git. `bin/test project`
  runs this test; `mix test` skips it, because it builds everything again.
  """

  use ExUnit.Case, async: false

  alias BB.Test.{Project, Run}

  @moduletag :project
  @moduletag timeout: 1_800_000

  defp mixfile(dependency) do
    """
    defmodule Rover.MixProject do
      use Mix.Project

      def project do
        [
          app: :rover,
          version: "0.1.0",
          compilers: Mix.compilers() ++ [:cargo],
          cargo: [programs: ["detector"]],
          deps: [{:ganglion, #{dependency}}]
        ]
      end

      def application, do: [extra_applications: [:logger]]
    end
    """
  end

  @robot """
  defmodule Rover do
    @moduledoc false
    use BB

    sensors do
      sensor :detector, {BB.Sensor.NativeProcess, program: {:rover, "detector"}}

      sensor :imu_outlet,
             {BB.Handoff.Outlet,
              from: [:sensor, :base_link, :imu], topic: "imu", encoding: BB.Handoff.Encoding.Imu}
    end

    topology do
      link :base_link do
        sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1"}, max_silence: ~u(1 second)
        sensor :bumper, {BB.Sensor.ContactSwitch, line: {"gpiochip0", 17}}
      end
    end

    simulation do
      i2c "i2c-1" do
        device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}
      end

      gpio "gpiochip0" do
        device :bumper, {BB.Bus.Sim.Contact, pins: [contact: 17]}
      end
    end
  end
  """

  @crate """
  [package]
  name = "detector"
  version = "0.1.0"
  edition = "2021"
  """

  @detector """
  fn main() {
      println!("the detector looks");
      loop {
          std::thread::park();
      }
  }
  """

  # Prints the processes that run before the robot, and then the messages of the robot.
  @run """
  started = Application.started_applications() |> Enum.map(&elem(&1, 0)) |> Enum.sort()
  IO.puts("started \#{inspect(started)}")
  {:ok, _} = Rover.start_link(topic_prefix: System.fetch_env!("ROVER_PREFIX"))
  for path <- [[:imu], [:bumper]] do
    {:ok, _} = BB.subscribe(Rover, [:sensor, :base_link | path])
    receive do: ({:bb, [:sensor, :base_link | ^path], _message} -> IO.puts("heard \#{inspect(path)}"))
  end
  topic = BB.topic(Rover, "imu")
  Stream.repeatedly(fn -> BB.Ring.info(topic) end)
  |> Enum.find(&match?({:ok, %{published: n}} when n > 0, &1))
  IO.puts("published on \#{topic}")
  Stream.repeatedly(fn -> BB.Sensor.health(Rover) end)
  |> Enum.find(fn rows -> Enum.all?(rows, &(&1.state == :up)) end)
  IO.puts("all up")
  :ok = Supervisor.stop(Rover)
  """

  for how <- [:path, :git] do
    describe "a project that depends on it by #{how}" do
      @describetag how: how

      test "is built, runs its robot and its own program, and has the selected parts", %{how: how} do
        project = project(how)
        Project.run!(project, "mix", ["deps.get"])
        text = Project.run!(project, "mix", ["compile"])
        refute text =~ "warning:"
        assert programs(project, "ganglion") == ["camera", "process_guard"]
        assert programs(project, "rover") == ["detector"]

        prefix = Run.unique("rover")
        text = Project.run!(project, "mix", ["run", "-e", @run], [{"ROVER_PREFIX", prefix}])
        assert started(text) -- allowed() == []
        assert text =~ "heard [:imu]"
        assert text =~ "heard [:bumper]"
        assert text =~ "published on #{prefix}.imu"
        assert text =~ "all up"
        assert text =~ "detector: the detector looks"

        assert nothing_done?(Project.run!(project, "mix", ["compile"]))
        follows_its_list(project, how)

        for app <- ["ganglion", "rover"], do: assert_portable(project, app)
      end
    end
  end

  defp project(how) do
    folder = Project.folder("project")

    dependency =
      case how do
        :path -> ~s(path: "#{Project.checkout()}")
        :git -> ~s(git: "#{Project.clone!(Path.join(folder, "ganglion"))}")
      end

    folder
    |> Path.join("rover")
    |> tap(&File.mkdir_p!/1)
    |> Project.in_folder(how)
    |> Project.write!([
      {"mix.exs", mixfile(dependency)},
      {"config/config.exs", asking("[:camera]")},
      {"lib/rover.ex", @robot},
      {"native/Cargo.toml", @crate},
      {"native/src/main.rs", @detector}
    ])
  end

  defp asking(programs), do: "import Config\nconfig :ganglion, programs: #{programs}\n"

  # Another cargo on the machine may hold the lock.
  defp nothing_done?(text),
    do: text |> String.split("\n", trim: true) |> Enum.all?(&(&1 =~ "Blocking waiting"))

  defp programs(project, app) do
    project.folder |> Path.join("_build/dev/lib/#{app}/priv/bin") |> File.ls!() |> Enum.sort()
  end

  # The applications that a library may start, in any project.
  defp allowed,
    do:
      [:compiler, :elixir, :ganglion, :kernel, :logger, :rover, :sasl, :stdlib] ++
        [:mix, :iex, :hex]

  defp started(text) do
    [_, list] = Regex.run(~r/^started (\[.*\])$/m, text)
    {applications, _} = Code.eval_string(list)
    applications
  end

  # A deselected program is removed, and an unknown name is an error. A git dependency is rebuilt
  # only after a command, which Mix suggests.
  defp follows_its_list(project, how) do
    Project.write!(project, [{"config/config.exs", asking("[]")}])
    {text, status} = Project.run(project, "mix", ["compile"])

    if status != 0 do
      assert {how, text} == {:git, text}
      assert text =~ "mix deps.compile ganglion --force"
      Project.run!(project, "mix", ["deps.compile", "ganglion", "--force"])
    end

    assert programs(project, "ganglion") == ["process_guard"]

    Project.write!(project, [{"config/config.exs", asking("[:kamera]")}])
    compile = if how == :git, do: ["deps.compile", "ganglion", "--force"], else: ["compile"]
    assert {text, 1} = Project.run(project, "mix", compile)

    assert text =~
             "config :ganglion, programs: expected a list of :camera, :ganglion, :vision_tags, got: [:kamera]"
  end

  defp assert_portable(project, app) do
    ebin = Path.join(project.folder, "_build/dev/lib/#{app}/ebin")
    assert [_ | _] = File.ls!(ebin)
    here = [Project.checkout(), System.user_home!() <> "/", Path.dirname(project.folder)]
    assert Project.baked(ebin, here) == []
  end
end
