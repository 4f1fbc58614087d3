defmodule ArchitectureTest do
  @moduledoc """
  Checks which part of the project may name which. A new dependency fails here: it is a mistake,
  or a new entry in a table below, which everyone who reads the change sees.

  The names are read from the sources (`BB.Test.Source` explains why), so that `use`, `alias`,
  types and patterns count as well as calls. Only Ganglion's own modules are checked, those in
  `lib/bb` and `lib/ganglion` and the Mix tasks, not a robot or a driver beside them. For Rust,
  the dependencies in each `Cargo.toml` are checked, without which a crate cannot name another.
  """

  use ExUnit.Case, async: true

  alias BB.Test.Source

  # Each part: its modules, and the other parts that it may name. `BB.Math.*` stands for BB.Math
  # and all modules below it; if several patterns match a module, the longest one counts. A part
  # may name only parts above it, so that dependencies have no cycle.
  @parts [
    # Mix tasks that run without the application.
    mix: {~w(Mix.Tasks.Compile.Cargo.*), []},
    path: {~w(BB.Path), []},
    error: {~w(BB.Error.*), []},
    options: {~w(BB.Options.*), []},
    math: {~w(BB.Math.*), []},
    unit: {~w(BB.Unit.*), []},
    reference: {~w(BB.Parameter.Reference), []},
    unit_option: {~w(BB.Unit.Option), ~w(options unit reference)a},
    native_library: {~w(BB.NativeLibrary), []},
    callback: {~w(BB.Callback.*), []},
    telemetry: {~w(BB.Telemetry), [:callback]},
    diagnostic: {~w(BB.Diagnostic), [:telemetry]},
    errno: {~w(BB.Errno), []},
    topic: {~w(BB.Topic), []},
    tolerant: {~w(BB.Process.Tolerant), []},
    process_name: {~w(BB.Process.Name), []},
    envelope: {~w(BB.Message BB.Message.Compiler.*), [:options]},
    payload:
      {~w(BB.Message.* BB.Command.Event BB.StateMachine.Transition BB.Safety.HardwareError),
       [:envelope, :options, :math]},

    # The bus moves messages and does not read them: no payload.
    pub_sub: {~w(BB.PubSub.*), [:path, :options, :envelope, :tolerant]},

    # Parameters, and the transmission between a joint and a motor.
    parameter:
      {~w(BB.Parameter.*),
       ~w(pub_sub envelope options unit unit_option reference tolerant process_name callback)a},
    transmission: {~w(BB.Transmission), ~w(parameter reference envelope payload options unit)a},

    # Components and the processes that start and restart them. The declaration is data: the robot
    # and its components.
    process: {~w(BB.Process.*), [:process_name]},
    safety: {~w(BB.Safety.*), ~w(path pub_sub envelope payload callback telemetry tolerant)a},
    declaration:
      {~w(BB.Component BB.Robot.*),
       ~w(transmission parameter reference envelope payload unit math error)a},
    resolver:
      {~w(BB.Transmission.Resolver), ~w(declaration transmission parameter reference pub_sub)a},
    component:
      {~w(BB.Component.*),
       ~w(declaration transmission parameter reference process pub_sub safety envelope payload options callback telemetry tolerant topic)a},

    # The buses, simulated if there are no others. A robot may declare their simulated devices.
    clock: {~w(BB.Clock.*), [:tolerant]},
    bus_interface: {~w(BB.Bus.GPIO.Arguments BB.Bus.I2C.Scan), []},
    simulation: {~w(BB.Bus.Sim.*), [:clock, :tolerant, :bus_interface]},
    bus:
      {~w(BB.Bus.*), ~w(bus_interface simulation clock errno process tolerant native_library)a},

    # The kinds of components.
    sensor:
      {~w(BB.Sensor BB.Sensor.Server BB.Sensor.SensorProfile BB.Actuator.* BB.Estimator.*
          BB.Bridge
          BB.Controller BB.Controller.Server BB.Controller.Action.*),
       ~w(declaration resolver component transmission process safety parameter pub_sub envelope payload options topic telemetry callback error)a},

    # The components of a simulated robot.
    simulated:
      {~w(BB.Sim.* BB.Sensor.OpenLoopPositionEstimator.Motion),
       ~w(sensor envelope payload tolerant)a},
    dsl:
      {~w(BB.Dsl.* BB.Robot.Builder BB.Robot.Components BB.Robot.Shapes),
       ~w(declaration transmission parameter reference sensor simulation path topic options callback unit)a},

    # The robot's state and its commands.
    runtime:
      {~w(BB.Robot.Runtime BB.Command.*),
       ~w(dsl declaration component parameter reference safety process pub_sub envelope payload options callback error tolerant)a},
    supervisor:
      {~w(BB.Supervisor.* BB.TopologySupervisor BB.SensorSupervisor BB.ControllerSupervisor
          BB.BridgeSupervisor BB.Command.Supervisor BB.CommandSupervisor BB.TaskSupervisor),
       ~w(runtime dsl declaration component sensor simulated parameter reference safety process pub_sub bus simulation topic options callback tolerant)a},
    facade: {~w(BB), ~w(dsl runtime supervisor process pub_sub topic path envelope)a},

    # Sensors and controllers without a device, which use a robot as its users do.
    derived:
      {~w(BB.Sensor.Mimic BB.Sensor.OpenLoopPositionEstimator.* BB.Controller.PatternMatch
          BB.Controller.Threshold),
       ~w(facade runtime sensor simulated declaration pub_sub envelope payload unit unit_option options)a},

    # Drivers, and their interface to the bus. They cannot name the simulation behind it.
    loop: {~w(BB.Loop), ~w(clock envelope unit telemetry)a},
    polled: {~w(BB.Sensor.Polled), ~w(sensor loop unit)a},
    driver:
      {~w(BB.Sensor.*),
       ~w(sensor polled clock loop bus safety envelope payload math unit options)a},

    # The sensor of a native process reads the topics of its program, and forwards no messages.
    ring: {~w(BB.Ring.*), ~w(topic options errno native_library)a},
    native_process: {~w(BB.Sensor.NativeProcess.*), ~w(sensor ring topic options)a},

    # The tests that all drivers have to pass. They use a robot, and break its wires.
    conformance:
      {~w(BB.Sensor.Conformance.*),
       ~w(facade sensor bus simulation clock parameter pub_sub envelope payload unit options)a},

    # Outlets and inlets are sensors too, docs/decisions/0003.
    handoff: {~w(BB.Handoff.*), ~w(facade sensor ring topic envelope payload math options)a},

    # Validation, updates and network of a board.
    firmware:
      {~w(BB.Firmware.*),
       ~w(facade sensor driver native_process handoff ring topic safety process pub_sub envelope payload options tolerant)a},

    # Composition.
    ganglion:
      {~w(Ganglion.*),
       ~w(firmware errno facade supervisor runtime sensor driver native_process handoff ring bus simulation safety process parameter pub_sub path envelope payload math callback)a},

    # Mix tasks for people.
    tasks: {~w(Mix.Tasks.*), [:ganglion]}
  ]

  # The modules that may call a function of a module that is a value without BB.Callback, and why.
  # Functions that are values are not checked: the receiver calls them.
  @callers [
    {~w(BB.Callback), "is where the code of others is called"},

    # In the process of the component, which only its own code can harm: its keeper restarts it,
    # and kills it if it does not end.
    {~w(BB.Component.Server BB.Estimator.Server BB.Actuator.CommandCheck BB.Sensor.Polled BB.Sensor.NativeProcess.*
        BB.Handoff.Inlet BB.Handoff.Outlet),
     "calls in the process of the component, for some at each message"},
    {~w(BB.Controller.Action BB.Controller.PatternMatch),
     "calls what the robot declares, in the process of the controller"},
    {~w(BB.Command.Server BB.Command.Outcome),
     "calls the handler in the process of its execution"},
    {~w(BB.Safety.Round), "calls each disarm/1 in a process of its own, with a deadline"},
    {~w(BB.Process.Successor), "starts what the supervisor starts in whose process it is"},

    # In the process of the caller.
    {~w(BB.Error), "asks an error for its severity"},
    {~w(BB.Component.OptionsSchema BB.Component.Resolution BB.Options.Type),
     "checks in its caller's process; for a robot's components that is BB.Component.OptionsCheck's"},
    {~w(BB.Telemetry), "calls in the emitting process, unless that emits apart"},
    {~w(BB.Parameter), "asks a module for what its caller registers"},
    {~w(BB.Message.*), "makes a payload, in its maker's process"},

    # Modules from the configuration of the machine or of the robot.
    {~w(BB.Bus.I2C.* BB.Bus.GPIO.*), "calls the bus that the configuration names"},
    {~w(BB.Bus.Sim.*), "breaks a simulated device that fails, in the process of its bus"},
    {~w(BB.Firmware.*), "calls the board and the network that the configuration names"},
    {~w(BB.Parameter.*),
     "calls the store that the robot names, in the process of the parameters"},
    {~w(BB.Component.Health BB.Component.DeclaredRate BB.Component.ShutdownLimit BB.Process.*),
     "calls the registry that the robot's settings name"},
    {~w(BB.Supervisor.*), "calls the supervisors that the robot's settings name"},
    {~w(BB.Dsl.*), "calls while a robot is compiled, which is all that it can hurt"},
    {~w(Ganglion.New.Templates), "calls EEx, while a project is written"},

    # For tests and demonstrations.
    {~w(BB.Sensor.Conformance.* Ganglion.Demo.*), "starts a robot of its own"},
    {~w(Mix.Tasks.*), "prints by Mix's own shell, whichever that is"}
  ]

  # Functions that Ganglion's own macros define, or that kinds of components have.
  @made ~w(robot module_info component_kind component_options component_start component_request
           component_apply health __bb_arm_command__ __bb_disarm_command__)a

  # Foreign modules, by the beginning of their names, and the modules that may name them.
  @boards ~w(Nerves Shoehorn VintageNet MdnsLite Circuits)
  @outside [
    {@boards, ~w(BB.Bus.* BB.Firmware.*)},
    {~w(Rustler), ~w(BB.NativeLibrary)}
  ]

  # Each crate: the crates of this repository that it may depend on. Siblings that use the ring do
  # not name each other.
  @crates %{
    "conduit_ring" => [],
    "conduit_ring_c" => ["conduit_ring"],
    "conduit_ring_nif" => ["conduit_ring"],
    "ganglion_messages" => [],
    "languages" => ["conduit_ring"],
    "linux_bus_nif" => [],
    "process_guard" => ["program"],
    "program" => [],
    "camera" => ["conduit_ring", "ganglion_messages", "program"],
    "vision_tags" => ["conduit_ring", "ganglion_messages", "program"],
    "ganglion_cli" => ["conduit_ring", "ganglion_messages", "program"],
    "chaos" => ["conduit_ring", "program"]
  }

  # Additional dependencies of a crate's tests: the detector is tested with the camera's rendered
  # scene.
  @crates_in_tests %{"vision_tags" => ["camera"]}

  # Crates that call the operating system, and the files that may name them.
  @system_crates ~w(libc rustix nix)
  @system_files %{
    "conduit_ring" =>
      for(
        file <- ~w(clock event file futex lock mapping process),
        do: "native/conduit_ring/src/os/#{file}.rs"
      ),
    "linux_bus_nif" =>
      for(file <- ~w(adapter device errno watcher), do: "native/linux_bus_nif/src/#{file}.rs"),
    "process_guard" =>
      for(file <- ~w(guard process watch), do: "native/process_guard/src/#{file}.rs")
  }

  # All other crates have no `unsafe` outside of tests.
  @unsafe_crates ~w(camera conduit_ring conduit_ring_c conduit_ring_nif linux_bus_nif process_guard)

  @homeless ~w(utils util helpers helper common misc)

  setup_all do
    %{sources: Enum.map(Source.own(), &Source.read!/1)}
  end

  describe "the parts" do
    test "each name only parts above themselves" do
      for {{part, {_, may_name}}, index} <- Enum.with_index(@parts) do
        above = @parts |> Enum.take(index) |> Keyword.keys()
        assert may_name -- above == [], "#{part} names a part that does not stand above it"
      end
    end

    test "contain all our modules", %{sources: sources} do
      homeless = for source <- sources, module <- source.modules, !part(module), do: module
      assert homeless == [], "no part in @parts has #{inspect(homeless)}"
    end

    test "all have modules", %{sources: sources} do
      inhabited = for source <- sources, uniq: true, do: part(hd(source.modules))
      assert Keyword.keys(@parts) -- inhabited == []
    end
  end

  describe "a module" do
    test "names only parts that its part may name", %{sources: sources} do
      assert_none(sources, &forbidden_parts/1)
    end

    test "of a driver names no other driver", %{sources: sources} do
      assert_none(sources, &other_drivers/1)
    end

    test "of a driver names one bus at most", %{sources: sources} do
      assert_none(sources, &second_bus/1)
    end

    test "names foreign modules only where they belong", %{sources: sources} do
      assert_none(sources, &forbidden_outside/1)
    end

    test "of Nerves, VintageNet or Circuits is named by at most one of ours", %{sources: sources} do
      namers =
        for source <- sources,
            {name, _line} <- source.names,
            String.starts_with?(inspect(name), @boards),
            uniq: true do
          {name, source.file}
        end

      assert namers == Enum.uniq_by(namers, &elem(&1, 0))
    end

    test "calls foreign code only with BB.Callback, unless @callers says why", %{
      sources: sources
    } do
      assert_none(sources, &foreign_calls/1)
    end

    test "has the name of its file", %{sources: sources} do
      assert_none(sources, &misnamed/1)
    end
  end

  # The compiler's references. They exclude types, which make no file depend on another.
  test "no reference cycle has more than three files" do
    assert [] == for(cycle <- cycles(references()), length(cycle) > 3, do: Enum.sort(cycle))
  end

  test "the application has exactly the modules in lib/", %{sources: sources} do
    compiled =
      for module <- Application.spec(:ganglion, :modules),
          file = Path.relative_to_cwd(to_string(module.module_info(:compile)[:source])),
          match?("lib/" <> _, file),
          uniq: true,
          do: file

    assert Enum.map(sources, & &1.file) -- compiled == []
    assert compiled -- Path.wildcard("lib/**/*.ex") == []
  end

  test "no folder and no file has a name such as utils" do
    ours = ~w(lib/{bb,ganglion,mix} test bench examples docs bin native/*/{src,tests})
    paths = Enum.flat_map(ours, &tree/1)

    homeless =
      Enum.filter(paths, fn path ->
        Enum.any?(Path.split(path), &(Path.rootname(&1) in @homeless))
      end)

    assert homeless == [], "a function without a home is a missing noun: #{inspect(homeless)}"
  end

  describe "the test itself" do
    @tag :tmp_dir
    test "ignores a robot or a driver beside Ganglion's own modules", %{tmp_dir: dir} do
      files = ~w(lib/bb.ex lib/bb/sensor/own.ex lib/ganglion/x.ex lib/rover.ex lib/rover/utils.ex)
      for file <- files, path = Path.join(dir, file), do: File.mkdir_p!(Path.dirname(path))
      for file <- files, do: File.write!(Path.join(dir, file), "")
      assert Source.own(dir) == Enum.take(files, 3)
      assert "lib/bb/path.ex" in Source.own()
    end

    test "sees a cycle of files, of any length" do
      chain = for n <- 1..5, do: {n, n + 1}
      assert [[6]] = for(cycle <- cycles(chain), 6 in cycle, do: cycle)
      assert [[1, 2, 3, 4, 5, 6]] = [{6, 1} | chain] |> cycles() |> Enum.map(&Enum.sort/1)
    end

    test "reads the references of the compiler" do
      assert {"lib/bb/sensor/polled.ex", "lib/bb/loop.ex"} in references()
    end

    test "finds a forbidden dependency in any form, with file and line" do
      source = """
      defmodule BB.PubSub.Reader do
        alias BB.Message.Sensor.{Imu, Range}
        alias BB.{Path, Sensor}
        import BB.Dsl, only: []
        use BB.Handoff.Made.Up

        @type t :: BB.Ring.Publisher.t()

        def read(%BB.Robot.Link{}), do: Sensor.Mpu6050
        def read(%Imu{}), do: {Path, :"Elixir.Ganglion.Robot"}

        defmacro a_driver, do: quote(do: BB.Sensor.health(BB.Unknown))
      end
      """

      assert source |> judge("lib/bb/pub_sub/reader.ex", &forbidden_parts/1) |> arrows() == [
               {2, "BB.Message.Sensor.Imu", "payload"},
               {2, "BB.Message.Sensor.Range", "payload"},
               {3, "BB.Sensor", "sensor"},
               {4, "BB.Dsl", "dsl"},
               {5, "BB.Handoff.Made.Up", "handoff"},
               {7, "BB.Ring.Publisher", "ring"},
               {9, "BB.Robot.Link", "declaration"},
               {9, "BB.Sensor.Mpu6050", "driver"},
               {10, "BB.Message.Sensor.Imu", "payload"},
               {10, "Ganglion.Robot", "ganglion"},
               {12, "BB.Sensor", "sensor"},
               {12, "BB.Unknown", "no part"}
             ]
    end

    test "reports the rule and the place" do
      source = "defmodule BB.Path do\n  alias BB.Unit\nend\n"

      assert judge(source, "lib/bb/path.ex", &forbidden_parts/1) == [
               "lib/bb/path.ex:2: path -> unit: BB.Path names BB.Unit; path may name nothing else"
             ]
    end

    test "accepts the allowed dependencies" do
      source = """
      defmodule BB.Sensor.Thing do
        use BB.Sensor
        alias BB.{Loop, Message}
        alias __MODULE__.Registers
        def read, do: {Loop, Message, Registers, Enum, BB.Bus.I2C, BB.Math.Vec3}
      end
      """

      for rule <- [
            &forbidden_parts/1,
            &other_drivers/1,
            &second_bus/1,
            &forbidden_outside/1,
            &misnamed/1
          ],
          do: assert(judge(source, "lib/bb/sensor/thing.ex", rule) == [])
    end

    test "finds a driver that names another, two buses, a board's library or a wrong file name" do
      source = """
      defmodule BB.Sensor.Thing do
        alias BB.Sensor.Mpu6050, as: Other
        def read, do: {Other.Registers, BB.Bus.I2C, BB.Bus.GPIO}
        def there?, do: Circuits.I2C.detect_devices("i2c-1")
      end
      """

      assert [~s(lib/bb/sensor/other.ex:2:) <> _, ~s(lib/bb/sensor/other.ex:3:) <> _] =
               judge(source, "lib/bb/sensor/other.ex", &other_drivers/1)

      assert [two_buses] = judge(source, "lib/bb/sensor/other.ex", &second_bus/1)
      assert two_buses =~ "BB.Bus.I2C, BB.Bus.GPIO"
      assert [outside] = judge(source, "lib/bb/sensor/other.ex", &forbidden_outside/1)
      assert outside =~ "lib/bb/sensor/other.ex:4: BB.Sensor.Thing names Circuits.I2C"
      assert [misnamed] = judge(source, "lib/bb/sensor/other.ex", &misnamed/1)
      assert misnamed =~ "lib/bb/sensor/other.ex defines BB.Sensor.Thing"
    end

    test "finds a call of an unknown module in any form" do
      source = """
      defmodule BB.Sensor.Thing do
        def words(row, reason), do: row.module.explain(reason)
        def rate(%{module: module}, opts), do: opts |> module.rate()
        def bare(module), do: module.inhibition
        def all(module, list), do: Enum.map(list, &module.explain/1)
        def one(module, list), do: Enum.map(list, &module.explain(&1))
        def by_name(module), do: apply(module, :rate, [[]])
        def elsewhere(module), do: spawn(module, :rate, [[]])
        def erlang(module), do: :erlang.apply(module, :rate, [[]])
        def kernel(module), do: Kernel.apply(module, :rate, [[]])
        def task(module), do: Task.async(module, :rate, [[]])
        def of_a_robot(robot), do: robot.robot().components
        def known(row), do: {row.module, BB.Sensor.Mpu6050.rate([]), __MODULE__.rate(row.options)}
      end
      """

      lines =
        for sentence <- judge(source, "lib/bb/sensor/thing.ex", &foreign_calls/1) do
          [_, line] = Regex.run(~r/^[^:]+:(\d+): /, sentence)
          String.to_integer(line)
        end

      assert lines == Enum.to_list(2..11)
    end
  end

  describe "a crate" do
    test "depends only on the crates of ours that it may" do
      for {crate, manifest} <- crates() do
        assert Map.has_key?(@crates, crate), "no row in @crates has #{crate}"
        broken = forbidden_crates(crate, manifest)
        assert broken == [], Enum.join(broken, "\n")
      end
    end

    test "that names a sibling is found, with file and line" do
      manifest = """
      [dependencies]
      conduit_ring.workspace = true
      camera.workspace = true

      [dev-dependencies]
      vision_tags = { path = "../vision_tags" }
      """

      assert forbidden_crates("conduit_ring_nif", manifest) == [
               "native/conduit_ring_nif/Cargo.toml:3: conduit_ring_nif -> camera",
               "native/conduit_ring_nif/Cargo.toml:6: conduit_ring_nif -> vision_tags, for its tests"
             ]
    end

    test "calls the operating system only in the designated files" do
      for {crate, manifest} <- crates() do
        files = Map.get(@system_files, crate, [])

        for name <- dependencies(manifest, ~w(dependencies build-dependencies)),
            name in @system_crates,
            do: assert(files != [], "native/#{crate}/Cargo.toml: #{crate} -> #{name}")

        calls = ~r/\b(#{Enum.join(@system_crates, "|")})::|\bextern\s+"C"\s*\{|\basm!/
        assert rust_lines("native/#{crate}/src", calls) |> reject_files(files) == []
      end
    end

    test "has unsafe code only if it handles memory or other languages" do
      for {crate, _manifest} <- crates(), crate not in @unsafe_crates do
        assert rust_lines("native/#{crate}/src", ~r/\bunsafe\b/) == []
      end
    end
  end

  test "the reader of Cargo.toml finds dependencies in any form" do
    manifest = """
    [dependencies]
    conduit_ring.workspace = true
    # camera = "1"
    png = { version = "1", features = [
      "std",
    ] }
    renamed = { package = "vision_tags", path = "../vision_tags" }

    [dependencies.program]
    workspace = true

    [target.'cfg(unix)'.dependencies]
    camera = { path = "../camera" }

    [dev-dependencies]
    process_guard = "1"
    """

    assert Enum.sort(dependencies(manifest, ~w(dependencies))) ==
             ~w(camera conduit_ring png program vision_tags)

    assert dependencies(manifest, ~w(dev-dependencies)) == ~w(process_guard)
  end

  # The rules: what a source violates, a sentence each.

  defp forbidden_parts(%Source{modules: [module | _]} = source) do
    {_, may_name} = @parts[part(module)] || {[], []}

    for {name, line} <- source.names,
        ours?(name),
        part(name) not in [part(module) | may_name] or part(name) == nil do
      "#{source.file}:#{line}: #{part(module)} -> #{part(name) || "no part"}: " <>
        "#{inspect(module)} names #{inspect(name)}; #{part(module)} may name #{listed(may_name)}"
    end
  end

  defp other_drivers(%Source{modules: [module | _]} = source) do
    for {name, line} <- source.names,
        part(module) == :driver,
        part(name) == :driver,
        chip(name) != chip(module) do
      "#{source.file}:#{line}: #{inspect(module)} names another driver, #{inspect(name)}"
    end
  end

  defp second_bus(%Source{modules: [module | _]} = source) do
    buses = for {name, _line} <- source.names, part(name) == :bus, uniq: true, do: inspect(name)

    if part(module) == :driver and length(buses) > 1,
      do: ["#{source.file}: #{inspect(module)} names several buses: #{Enum.join(buses, ", ")}"],
      else: []
  end

  defp forbidden_outside(%Source{modules: [module | _]} = source) do
    for {name, line} <- source.names,
        {outside, places} <- @outside,
        String.starts_with?(inspect(name), outside),
        not Enum.any?(places, &fits?(&1, module)) do
      "#{source.file}:#{line}: #{inspect(module)} names #{inspect(name)}, which belongs in #{Enum.join(places, " and ")}"
    end
  end

  defp foreign_calls(%Source{modules: [module | _]} = source) do
    listed? =
      Enum.any?(@callers, fn {callers, _why} -> Enum.any?(callers, &fits?(&1, module)) end)

    for {{name, text}, line} <- source.calls,
        not listed?,
        name not in [:fun | @made] do
      "#{source.file}:#{line}: #{inspect(module)} calls #{text}, which may be code of others: " <>
        "call it by BB.Callback, or say in @callers whom alone it can hurt"
    end
  end

  # File names join words, too: `transform2d.ex` has BB.Math.Transform2D.
  defp misnamed(%Source{modules: [module | inner]} = source) do
    path =
      source.file |> Path.rootname() |> String.split(["/", "."]) |> tl() |> Enum.map(&letters/1)

    named? = path == module |> Module.split() |> Enum.map(&letters/1)
    strangers = Enum.reject(inner, &fits?("#{inspect(module)}.*", &1))

    for stranger <- if(named?, do: strangers, else: [module | strangers]),
        do: "#{source.file} defines #{inspect(stranger)}, whose name is another file's"
  end

  defp letters(name), do: name |> String.replace("_", "") |> String.downcase()

  # Parts

  defp part(module) do
    fitting =
      for {part, {patterns, _}} <- @parts,
          pattern <- patterns,
          fits?(pattern, module),
          do: {pattern, part}

    with [_ | _] <- fitting,
         do: fitting |> Enum.max_by(&closeness(elem(&1, 0))) |> elem(1),
         else: ([] -> nil)
  end

  defp fits?(pattern, module) do
    case String.split(pattern, ".*") do
      [name] -> inspect(module) == name
      [name, ""] -> inspect(module) == name or String.starts_with?(inspect(module), name <> ".")
    end
  end

  # The length of a pattern without its star; an exact pattern precedes a family.
  defp closeness(pattern) do
    name = String.replace_suffix(pattern, ".*", "")
    {byte_size(name), name == pattern}
  end

  defp ours?(module),
    do: hd(Module.split(module)) in ["BB", "Ganglion"] or part(module) in [:mix, :tasks]

  defp chip(module), do: module |> Module.split() |> Enum.take(3)
  defp listed([]), do: "nothing else"
  defp listed(parts), do: Enum.join(parts, ", ")

  # References between files, as `mix xref graph` prints them: a file, and below it the files that
  # it names.

  defp references do
    ExUnit.CaptureIO.capture_io(fn -> Mix.Task.rerun("xref", ~w(graph --format plain)) end)
    |> String.split("\n", trim: true)
    |> Enum.map_reduce(nil, fn line, file ->
      case String.split(line) do
        [file] -> {{file, file}, file}
        [_branch, named | _kind] -> {{file, named}, file}
      end
    end)
    |> elem(0)
  end

  defp cycles(references) do
    graph = :digraph.new()

    for {file, named} <- references,
        vertex <- [file, named],
        do: :digraph.add_vertex(graph, vertex)

    for {file, named} <- references, do: :digraph.add_edge(graph, file, named)
    cycles = :digraph_utils.strong_components(graph)
    :digraph.delete(graph)
    cycles
  end

  # Sources

  defp assert_none(sources, rule) do
    case Enum.flat_map(sources, rule) do
      [] -> :ok
      broken -> flunk(Enum.join(broken, "\n"))
    end
  end

  defp judge(text, file, rule), do: text |> Source.parse!(file) |> rule.()

  defp arrows(sentences) do
    for sentence <- sentences do
      [_, line, to, name] = Regex.run(~r/:(\d+): .* -> (.+): .* names (\S+);/, sentence)
      {String.to_integer(line), name, to}
    end
  end

  defp tree(pattern), do: Path.wildcard(pattern <> "/**") ++ Path.wildcard(pattern)

  # Crates

  defp crates do
    [_, members] = Regex.run(~r/members = \[(.*?)\]/s, File.read!("native/Cargo.toml"))

    for [_, crate] <- Regex.scan(~r/"([^"]+)"/, members),
        do: {crate, File.read!("native/#{crate}/Cargo.toml")}
  end

  defp forbidden_crates(crate, manifest) do
    may_name = Map.fetch!(@crates, crate)
    in_tests = may_name ++ Map.get(@crates_in_tests, crate, [])

    for {kinds, allowed, why} <- [
          {~w(dependencies build-dependencies), may_name, ""},
          {~w(dev-dependencies), in_tests, ", for its tests"}
        ],
        name <- dependencies(manifest, kinds),
        Map.has_key?(@crates, name) and name not in allowed,
        do: "native/#{crate}/Cargo.toml:#{line_of(manifest, name)}: #{crate} -> #{name}#{why}"
  end

  defp line_of(text, word) do
    lines = String.split(text, "\n")
    1 + Enum.find_index(lines, &(&1 =~ ~r/\b#{word}\b/ and not String.starts_with?(&1, "#")))
  end

  # The crate names in sections of these kinds, also in sections for one target or for one crate.
  defp dependencies(manifest, kinds) do
    kinds = Enum.join(kinds, "|")

    manifest
    |> String.split("\n")
    |> Enum.reduce({nil, []}, fn line, {section, found} ->
      case {Regex.run(~r/^\[(.+)\]/, line), section} do
        {[_, header], _} ->
          entered(Regex.run(~r/(?:^|\.)(?:#{kinds})(?:\.(.+))?$/, header), found)

        {nil, :inside} ->
          {section, dependency(line) ++ found}

        {nil, nil} ->
          {nil, found}
      end
    end)
    |> elem(1)
    |> Enum.reverse()
  end

  defp entered(nil, found), do: {nil, found}
  defp entered([_], found), do: {:inside, found}
  defp entered([_, crate], found), do: {nil, [crate | found]}

  defp dependency(line) do
    renamed = Regex.run(~r/package\s*=\s*"([^"]+)"/, line)
    named = Regex.run(~r/^([\w-]+)\s*[.=]/, line)

    Enum.take(
      List.wrap(renamed && Enum.at(renamed, 1)) ++ List.wrap(named && Enum.at(named, 1)),
      1
    )
  end

  # `file:line` of each matching line of Rust, without comments.
  defp rust_lines(folder, regex) do
    for file <- Path.wildcard(folder <> "/**/*.rs"),
        {line, number} <- file |> File.stream!() |> Stream.with_index(1),
        line |> String.replace(~r"//.*", "") |> String.match?(regex),
        do: "#{file}:#{number}"
  end

  defp reject_files(places, files),
    do:
      Enum.reject(places, fn place -> Enum.any?(files, &String.starts_with?(place, &1 <> ":")) end)
end
