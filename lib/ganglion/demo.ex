defmodule Ganglion.Demo do
  @moduledoc """
  The demonstration: runs a robot and shows its sensors and ring topics once a second.

  `bin/demo` calls it, and so does the `bin/demo` of a project with a robot of its own:

      Ganglion.Demo.main(["--seconds", "10"], robot: Rover)

  It starts the robot on simulated buses or on the buses of the machine, and subscribes to all of
  its messages. At the end of the time or after SIGTERM, which `bin/demo` sends on Ctrl-C, it
  stops the robot and prints a summary.

  The ring topics of each run have a topic prefix of their own, such as `demo_4711.camera`
  (`BB.Topic`), so that several demonstrations and other robots can run at the same time.
  """

  alias BB.Bus.Sim
  alias BB.Sensor.NativeProcess.Program

  alias Ganglion.Demo.{
    Declaration,
    LogTail,
    Observation,
    Options,
    RealBuses,
    Report,
    Signals
  }

  alias Ganglion.{Json, Robot}

  @imu_address 0x68
  @log_lines 5

  defstruct [:options, :started, :screen?, :robot, :observation, :cpu_start, log: []]

  @doc """
  Runs the demonstration with the arguments of the command line and halts the VM with its status.

  The option `robot:` is the robot that it shows unless the arguments name one.
  """
  @spec main([String.t()]) :: no_return()
  @spec main([String.t()], robot: module()) :: no_return()
  def main(argv, opts \\ []) do
    from = System.get_env("GANGLION_CALLER_DIR", File.cwd!())

    status =
      case Options.parse(argv, from, Keyword.get(opts, :robot, Robot)) do
        {:ok, options} -> run(options)
        {:error, sentence} -> print_error(sentence, 2)
      end

    System.halt(status)
  end

  @doc """
  Runs the demonstration and returns its exit status.

  The status is 0, or 1 if it could not start. The reason is on standard error then.
  """
  @spec run(Options.t()) :: 0..1
  def run(options) do
    with :ok <- check_photographs(options.frames),
         {:ok, imu} <- imu_source(options.imu),
         :ok <- real_buses(options),
         {:ok, demo} <- start(options, imu) do
      demo |> watch() |> finish()
      0
    else
      {:error, sentence} -> print_error(sentence, 1)
    end
  end

  defp start(options, imu) do
    Application.put_env(:ganglion, :camera_args, camera_args(options.frames))
    {:ok, _} = Application.ensure_all_started(:ganglion)
    Process.flag(:trap_exit, true)
    :ok = Signals.forward_to(self())
    screen? = not options.json and System.get_env("GANGLION_TERMINAL") == "1"
    if screen?, do: LogTail.attach(self())

    :ok = start_recorded_imu(imu)

    case options.robot.start_link(topic_prefix: "demo_#{System.pid()}") do
      {:ok, robot} ->
        {:ok, _} = BB.subscribe(options.robot, [:sensor])

        {:ok,
         %__MODULE__{
           options: options,
           robot: robot,
           started: now(),
           screen?: screen?,
           observation: Observation.new([], now()),
           cpu_start: {cpu_ms(), now_ms()}
         }}

      {:error, reason} ->
        {:error, format_error(reason)}
    end
  end

  # A device that is on a bus already takes precedence over the robot's declaration.
  defp start_recorded_imu(nil), do: :ok

  defp start_recorded_imu(imu) do
    devices = %{@imu_address => {Sim.Mpu6050, source: imu}}
    {:ok, _} = Sim.start_link(buses: %{"i2c-1" => [devices: devices]})
    :ok
  end

  # Counts messages and refreshes the screen each second, until the time is over or a signal
  # comes.

  defp watch(demo) do
    Process.send_after(self(), :refresh, 1000)

    _ =
      if demo.options.seconds, do: Process.send_after(self(), :over, demo.options.seconds * 1000)

    loop(demo)
  end

  defp loop(demo) do
    receive do
      {:bb, path, message} -> loop(observe(demo, &Observation.message(&1, path, message, now())))
      {:log, line} -> loop(%{demo | log: Enum.take([line | demo.log], @log_lines)})
      :refresh -> loop(refresh(demo))
      :over -> demo
      {:signal, :sigterm} -> demo
      {:EXIT, robot, _reason} when robot == demo.robot -> demo
      _other -> loop(demo)
    end
  end

  defp observe(demo, fun), do: %{demo | observation: fun.(demo.observation)}

  defp refresh(demo) do
    Process.send_after(self(), :refresh, 1000)
    demo = observe_topics(demo)
    show(demo)
    observe(demo, &Observation.look/1)
  end

  defp observe_topics(demo) do
    Enum.reduce(topics(demo.options.robot), demo, fn info, demo ->
      observe(demo, &Observation.topic(&1, info, now()))
    end)
  end

  defp topics(robot) do
    for topic <- Declaration.topics(robot), {:ok, info} <- [BB.Ring.info(topic)], do: info
  end

  defp finish(demo) do
    demo = observe_topics(demo)
    view = view(demo)
    stop_robot(demo.robot)

    if demo.options.json,
      do: print_json(Report.summary(view)),
      else: IO.write(["\n", Report.closing(view)])
  end

  defp stop_robot(robot) do
    Supervisor.stop(robot)
  catch
    :exit, _already_gone -> :ok
  end

  defp show(%{options: %{json: true}} = demo) do
    view = view(demo)
    print_json(Map.put(Report.summary(view), :seconds, Float.round(view.seconds, 1)))
  end

  defp show(%{screen?: true} = demo),
    do: IO.write([IO.ANSI.home(), IO.ANSI.clear(), Report.screen(view(demo))])

  defp show(demo), do: IO.write([Report.screen(view(demo)), "\n"])

  defp print_json(term), do: IO.puts(Json.encode(term))

  defp view(demo) do
    %{
      name: Declaration.name(demo.options.robot),
      observation: demo.observation,
      health: Enum.sort_by(BB.Sensor.health(demo.options.robot), & &1.name),
      carried:
        for(
          name <- Declaration.carriers(demo.options.robot),
          {:ok, stats} <- [BB.Handoff.stats(demo.options.robot, name)],
          into: %{},
          do: {name, stats}
        ),
      outputs: Declaration.outputs(demo.options.robot),
      vision?: Declaration.vision?(demo.options.robot),
      processor: processor_share(demo.cpu_start),
      seconds: (now() - demo.started) / 1.0e9,
      now: now(),
      log: Enum.reverse(demo.log)
    }
  end

  # The share of one core that all threads of the VM use; `nil` in the first second.
  defp processor_share({cpu_start_ms, start_ms}) do
    passed_ms = now_ms() - start_ms
    if passed_ms >= 1000, do: (cpu_ms() - cpu_start_ms) / passed_ms
  end

  defp cpu_ms, do: :runtime |> :erlang.statistics() |> elem(0)
  defp now_ms, do: System.monotonic_time(:millisecond)
  defp now, do: System.monotonic_time(:nanosecond)

  # Input

  defp real_buses(%{real: false}), do: :ok
  defp real_buses(options), do: RealBuses.use_for(options.robot, options.bus)

  defp imu_source(nil), do: {:ok, nil}

  defp imu_source(path) do
    case Sim.Recording.load(path) do
      {:ok, recording} -> {:ok, {:recording, recording}}
      {:error, error} -> {:error, format_error(error)}
    end
  end

  defp camera_args(nil), do: []
  # Detection takes longer on a photograph than on the rendered scene.
  defp camera_args(folder), do: ["--frames", folder, "--rate", "10"]

  # The camera program checks the photographs before the robot starts.
  defp check_photographs(nil), do: :ok

  defp check_photographs(folder) do
    case Program.find({:ganglion, "camera"}) do
      {:ok, camera} -> check_photographs(folder, camera)
      {:error, reason} -> {:error, Program.explain(reason)}
    end
  end

  defp check_photographs(folder, camera) do
    case System.cmd(camera, ["--frames", folder, "--check"], stderr_to_stdout: true) do
      {_, 0} -> :ok
      {text, _} -> {:error, String.trim(text)}
    end
  end

  defp format_error(reason), do: BB.Supervisor.format_error(reason)

  defp print_error(sentence, status) do
    IO.puts(:stderr, "demo: #{sentence}")
    status
  end
end
