defmodule Ganglion.Demo do
  @moduledoc """
  The demonstration behind `bin/demo`: a robot on simulated buses or on those of the machine, watched for a while. It is the
  robot that ships, the one with all drivers, or any other:

      Ganglion.Demo.main(["--seconds", "10"], robot: Rover)

  It starts the robot with its simulated buses, subscribes to everything that the robot publishes, and each second shows what came:
  of any robot its sensors, of one that speaks through the ring its topics too. SIGTERM (which `bin/demo` makes of Ctrl-C) and the
  end of the time stop the robot in order; then comes the summary.

  Each run has ring topics of its own, `demo_<number of the process>.camera` and so on (`BB.Topic`), so that demonstrations go on
  beside each other and beside other robots.
  """

  alias BB.Bus.Sim
  alias BB.Sensor.NativeProcess.Program

  alias Ganglion.Demo.{
    LogTail,
    Observation,
    Options,
    Processor,
    RealBuses,
    Report,
    Signals,
    Wiring
  }

  alias Ganglion.{Json, Robot}

  @imu_address 0x68
  @log_lines 5

  defstruct [:options, :started, :screen?, :robot, :observation, :processor, log: []]

  @doc """
  Runs the demonstration with the arguments of the command line and ends the VM with its exit status. `robot:` is the robot that
  it shows where the arguments name none.
  """
  @spec main([String.t()]) :: no_return()
  @spec main([String.t()], robot: module()) :: no_return()
  def main(argv, opts \\ []) do
    from = System.get_env("GANGLION_CALLER_DIR", File.cwd!())

    status =
      case Options.parse(argv, from, Keyword.get(opts, :robot, Robot)) do
        {:ok, options} -> run(options)
        {:error, mistake} -> fail(mistake, 2)
      end

    System.halt(status)
  end

  @doc "Runs the demonstration: 0, or 1 when it cannot start, after a line on standard error that says why."
  @spec run(Options.t()) :: 0..1
  def run(options) do
    with :ok <- check_photographs(options.frames),
         {:ok, imu} <- imu_source(options.imu),
         :ok <- real_buses(options),
         {:ok, demo} <- start(options, imu) do
      demo |> watch() |> finish()
      0
    else
      {:error, why} -> fail(why, 1)
    end
  end

  defp start(options, imu) do
    Application.put_env(:ganglion, :camera_args, camera_args(options.frames))
    {:ok, _} = Application.ensure_all_started(:ganglion)
    Process.flag(:trap_exit, true)
    :ok = Signals.forward_to(self())
    screen? = not options.json and System.get_env("GANGLION_TERMINAL") == "1"
    if screen?, do: LogTail.attach(self())

    :ok = record(imu)

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
           processor: Processor.start()
         }}

      {:error, reason} ->
        {:error, sentence(reason)}
    end
  end

  # What is on a bus already goes before what the robot declares.
  defp record(nil), do: :ok

  defp record(imu) do
    devices = %{@imu_address => {Sim.Mpu6050, source: imu}}
    {:ok, _} = Sim.start_link(buses: %{"i2c-1" => [devices: devices]})
    :ok
  end

  # The loop: messages as they come, a look each second, until the time is over or somebody stops it.

  defp watch(demo) do
    Process.send_after(self(), :look, 1000)

    _ =
      if demo.options.seconds, do: Process.send_after(self(), :over, demo.options.seconds * 1000)

    loop(demo)
  end

  defp loop(demo) do
    receive do
      {:bb, path, message} -> loop(observe(demo, &Observation.message(&1, path, message, now())))
      {:log, line} -> loop(%{demo | log: Enum.take([line | demo.log], @log_lines)})
      :look -> loop(look(demo))
      :over -> demo
      {:signal, :sigterm} -> demo
      {:EXIT, robot, _reason} when robot == demo.robot -> demo
      _other -> loop(demo)
    end
  end

  defp observe(demo, fun), do: %{demo | observation: fun.(demo.observation)}

  defp look(demo) do
    Process.send_after(self(), :look, 1000)
    demo = observe_topics(demo)
    show(demo)
    observe(demo, &Observation.looked/1)
  end

  defp observe_topics(demo) do
    Enum.reduce(topics(demo.options.robot), demo, fn info, demo ->
      observe(demo, &Observation.topic(&1, info, now()))
    end)
  end

  defp topics(robot) do
    for topic <- Wiring.topics(robot), {:ok, info} <- [BB.Ring.info(topic)], do: info
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
      name: name(demo.options.robot),
      observation: demo.observation,
      health: Enum.sort_by(BB.Sensor.health(demo.options.robot), & &1.name),
      carried:
        for(
          name <- Wiring.carriers(demo.options.robot),
          {:ok, stats} <- [BB.Handoff.stats(demo.options.robot, name)],
          into: %{},
          do: {name, stats}
        ),
      outputs: Wiring.outputs(demo.options.robot),
      vision?: Wiring.sees?(demo.options.robot),
      processor: Processor.share(demo.processor),
      seconds: (now() - demo.started) / 1.0e9,
      now: now(),
      log: Enum.reverse(demo.log)
    }
  end

  defp name(robot), do: to_string(robot.robot().settings[:name] || inspect(robot))

  defp now, do: System.monotonic_time(:nanosecond)

  # Input

  defp real_buses(%{real: false}), do: :ok
  defp real_buses(options), do: RealBuses.use_for(options.robot, options.bus)

  defp imu_source(nil), do: {:ok, nil}

  defp imu_source(path) do
    case Sim.Recording.load(path) do
      {:ok, recording} -> {:ok, {:recording, recording}}
      {:error, error} -> {:error, sentence(error)}
    end
  end

  defp camera_args(nil), do: []
  # Finding the tags of a photograph takes longer than of the rendered scene.
  defp camera_args(folder), do: ["--frames", folder, "--rate", "10"]

  # The camera itself says whether it can use the photographs, before anything is started.
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

  defp sentence(reason), do: BB.Supervisor.format_error(reason)

  defp fail(why, status) do
    IO.puts(:stderr, "demo: #{why}")
    status
  end
end
