defmodule ProjectTest do
  @moduledoc """
  Tests what a project inherits that depends on Ganglion by path and by git, or on its application
  `:bb` (`packages/bb`). `bin/test project` runs this test; `mix test` skips it, because it builds
  everything again.
  """

  use ExUnit.Case, async: false

  alias BB.Test.{Packages, Project, Run}

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

  @driver_mixfile """
  defmodule PowerMonitor.MixProject do
    use Mix.Project

    def project do
      [app: :power_monitor, version: "0.1.0", deps: [{:bb, "~> 0.30", path: "../bb"}]]
    end

    def application, do: [extra_applications: [:logger]]
  end
  """

  @bot_mixfile """
  defmodule Bot.MixProject do
    use Mix.Project

    def project do
      [
        app: :bot,
        version: "0.1.0",
        deps: [
          {:bb, path: "#{Path.join(Project.checkout(), "packages/bb")}", override: true},
          {:power_monitor, path: "../power_monitor"}
        ]
      ]
    end

    def application, do: [extra_applications: [:logger]]
  end
  """

  @bot """
  defmodule Bot do
    @moduledoc false
    use BB

    topology do
      link :base_link do
        sensor :battery, {PowerMonitor.Sensor, bus: "i2c-1", publish_rate: ~u(50 hertz)}
      end
    end
  end
  """

  # Prints what the application :bb is, then runs the robot.
  @run_bot """
  IO.puts("bb \#{Application.spec(:bb, :vsn)}")
  started = Application.started_applications() |> Enum.map(&elem(&1, 0)) |> Enum.sort()
  IO.puts("started \#{inspect(started)}")

  modules = for app <- [:bb, :ganglion], {:ok, modules} = :application.get_key(app, :modules),
                module <- modules, do: module
  IO.puts("twice \#{inspect(modules -- Enum.uniq(modules))}")

  {:error, %Spark.Options.ValidationError{key: :bus} = error} =
    Spark.Options.validate([bus: 1], PowerMonitor.Sensor.options_schema())
  IO.puts(Exception.message(error))

  try do
    raise Spark.Error.DslError, module: Bot, path: [:topology], message: "no link"
  rescue
    error in BB.Dsl.Error -> IO.puts("raised \#{error.message}")
  end

  {:ok, _} = Bot.start_link([])
  {:ok, _} = BB.subscribe(Bot, [:sensor, :base_link, :battery])
  receive do: ({:bb, _path, %{payload: %{voltage: 7.4}}} -> IO.puts("heard [:battery]"))
  :ok = Supervisor.stop(Bot)
  """

  describe "a project with a package that depends on :bb of Hex" do
    test "is built with packages/bb, whatever version the package asks for, and runs" do
      project = bot("~> 0.30")
      Project.run!(project, "mix", ["deps.get"])
      refute Project.run!(project, "mix", ["compile"]) =~ "warning:"
      text = Project.run!(project, "mix", ["run", "-e", @run_bot])
      assert text =~ "bb 0.31."
      assert started(text) -- [:bb, :bot, :power_monitor | allowed()] == []
      assert :bb in started(text)
      assert text =~ "twice []"
      assert text =~ "invalid value for :bus option: expected string, got: 1"
      assert text =~ "raised no link"
      assert text =~ "heard [:battery]"
      Project.run!(project, "mix", ["format", "--check-formatted"])

      bot("~> 7.0", Path.dirname(project.folder))
      text = Project.run!(project, "mix", ["run", "-e", @run_bot])
      assert text =~ "heard [:battery]"
    end
  end

  # The package's own dependency is a folder that does not exist, as :bb of Hex is not installed.
  defp bot(version, folder \\ Project.folder("bot")) do
    folder
    |> Project.in_folder(:path)
    |> Project.write!([
      {"power_monitor/mix.exs", String.replace(@driver_mixfile, "~> 0.30", version)},
      {"power_monitor/lib/power_monitor.ex", Packages.text("power_monitor")},
      {"bot/mix.exs", @bot_mixfile},
      {"bot/.formatter.exs", ~s([import_deps: [:bb], inputs: ["lib/bot.ex"]]\n)},
      {"bot/lib/bot.ex", @bot}
    ])

    folder |> Path.join("bot") |> Project.in_folder(:path)
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
