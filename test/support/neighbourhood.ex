defmodule BB.Test.Neighbourhood do
  @moduledoc """
  A robot with a failing sensor (`BB.Test.Mischief`), and everything that must not be affected.

  That is the sensor beside it, health, the console, the firmware's guard, and the stop of the
  robot.
  """

  import BB.Test.Eventually
  import BB.Test.Robot
  import ExUnit.Assertions
  import ExUnit.Callbacks
  import ExUnit.CaptureIO

  alias BB.Firmware.Board.Memory
  alias BB.Firmware.Guard
  alias BB.Test.{Brake, Mischief, Network, Run}
  alias BB.Test.Counter.Count

  @long_ms 60_000
  @path [:sensor, :base, :neighbour]

  @doc "The timeout of waits that are not measured."
  def long_ms, do: @long_ms

  @doc """
  Returns a robot with a working sensor, a sensor with a `disarm/1`, and the sensors under test.
  """
  def declared(extra) do
    create(
      quote do
        parameters do
          param :n, type: :integer, default: 1
        end

        topology do
          link :base do
            sensor :neighbour, BB.Test.Counter, required: true
            sensor :brake, BB.Test.Brake
            unquote_splicing(List.wrap(extra))
          end
        end
      end
    )
  end

  @doc "Returns the declaration of a sensor under test."
  def sensor(child), do: quote(do: sensor(:bad, unquote(Macro.escape(child))))

  @doc "Returns the declaration of an outlet or inlet with an encoding."
  def handoff(:decode, topic, encoding) do
    quote do
      sensor :bad, {BB.Handoff.Inlet, topic: unquote(topic), encoding: unquote(encoding)}
    end
  end

  def handoff(_callback, topic, encoding) do
    quote do
      sensor :bad,
             {BB.Handoff.Outlet,
              from: [:sensor, :base, :neighbour],
              topic: unquote(topic),
              encoding: unquote(encoding)}
    end
  end

  @doc "Returns the declaration of a driver that fails in that callback."
  def child(:handle_options, module),
    do: quote(do: sensor(:bad, {unquote(module), n: param([:n])}))

  def child(_callback, module), do: sensor(module)

  @doc """
  Starts a robot without a parent: an application's stop is simulated, independent of the test.
  """
  def start(robot) do
    {:ok, root} = robot.start_link()
    Process.unlink(root)
    on_exit(fn -> if Process.alive?(root), do: Process.exit(root, :kill) end)

    for name <- [:neighbour, :brake],
        do: assert(eventually(fn -> health(robot, name).state == :up end, @long_ms))

    root
  end

  @doc "Asserts that the sensor beside it runs in the same process, and publishes."
  def goes_on!(robot, neighbour) do
    listen = fn ->
      {:ok, _} = BB.subscribe(robot, @path)
      for _ <- 1..20, do: assert_receive({:bb, @path, %{payload: %Count{}}}, @long_ms)
    end

    listen |> Task.async() |> Task.await(@long_ms)
    assert BB.Process.whereis(robot, :neighbour) == neighbour
    assert Mischief.log_works?()
    assert %{state: :up, restarts: 0, declared_hz: nil} = health(robot, :neighbour)
  end

  @doc "Asserts that the console shows all of them."
  def console_shows!(robot) do
    for show <- [&Ganglion.Console.sensors/1, &Ganglion.Console.health/1] do
      text = capture_io(fn -> show.(robot) end)
      assert text =~ ~r/neighbour +.*up/
      refute text =~ "command failed"
    end
  end

  @doc "Asserts that the guard validates firmware with this robot."
  def guard_validates!(robot, context) do
    {:ok, memory} = Memory.start_link(status: :unvalidated, tell: self())
    topic = Run.unique("callback")
    on_exit(fn -> File.rm("/dev/shm/conduit_" <> topic) end)

    start_supervised!(
      {Guard,
       robot: robot,
       name: nil,
       board: {Memory, memory},
       network: {Network, start_supervised!({Network, :lan})},
       stability_ms: 50,
       fresh_ms: 5_000,
       deadline_ms: 600_000,
       poll_ms: 10,
       folder: context.tmp_dir,
       topic: topic,
       started_ms: System.monotonic_time(:millisecond)}
    )

    assert_receive {Memory, :validate}, @long_ms
    :ok = stop_supervised(Guard)
  end

  # The sensor under test may forbid arming permanently.
  defp arm(robot) do
    for {path, _reason} <- BB.Safety.inhibitions(robot), do: BB.Safety.allow(robot, path)
    assert BB.Safety.arm(robot) == :ok
  end

  @doc "Asserts that the armed robot stops, and is disarmed."
  def stops!(robot, root) do
    arm(robot)
    stop = Task.async(fn -> Supervisor.stop(root) end)
    assert Task.await(stop, @long_ms) == :ok
    refute BB.Safety.armed?(robot)
    assert Brake.runs(robot, [:base, :brake]) == 1
    # A sensor whose own disarm/1 failed may be unsafe.
    BB.Safety.force_disarm(robot)
  end

  @doc "Asserts that the failing sensor affects nothing else."
  def unnoticed!(robot, root, neighbour, context) do
    goes_on!(robot, neighbour)
    console_shows!(robot)
    guard_validates!(robot, context)
    assert [_, _, _] = BB.Sensor.health(robot)
    goes_on!(robot, neighbour)
    stops!(robot, root)
  end

  @doc "Waits until a module has failed."
  def happens!(module),
    do: assert(eventually(fn -> Mischief.happened(module) > 0 end, @long_ms))
end
