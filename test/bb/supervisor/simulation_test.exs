defmodule BB.Supervisor.SimulationTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Bus.Sim
  alias BB.Bus.Sim.Lines
  alias BB.Test.{Application, Brake, Run}

  doctest BB.Bus.Sim.Claims

  @motion {Sim.Mpu6050, source: :motion}
  @rail {Sim.Ina219, source: [voltage: 11.1, current: 1.5]}
  @other_rail {Sim.Ina219, source: [voltage: 5.0, current: 0.1]}

  defmodule Absent do
    @behaviour BB.Bus.Sim.Device

    @impl BB.Bus.Sim.Device
    def init(_opts, _now_ns), do: {:error, :no_recording}

    @impl BB.Bus.Sim.Device
    def write(_data, _now_ns, state), do: {:nak, state}

    @impl BB.Bus.Sim.Device
    def read(_count, _now_ns, state), do: {:nak, state}
  end

  setup do
    %{bus: Run.unique("i2c"), chip: Run.unique("gpiochip")}
  end

  # A robot with these devices on a bus, and on a chip of lines.
  defp simulated(bus, devices, chip \\ nil, lines \\ []) do
    devices =
      for {address, model} <- devices,
          do: quote(do: device(unquote_splicing([address, Macro.escape(model)])))

    lines =
      for {name, model} <- lines,
          do: quote(do: device(unquote_splicing([name, Macro.escape(model)])))

    create(
      quote do
        sensors do
          sensor :brake, BB.Test.Brake
        end

        simulation do
          i2c unquote(bus) do
            (unquote_splicing(devices))
          end

          gpio unquote(chip || bus) do
            (unquote_splicing(lines))
          end
        end
      end
    )
  end

  defp start(robot) do
    start_supervised!(robot)
    robot
  end

  defp on(bus) do
    case Sim.devices(bus) do
      {:error, reason} ->
        reason

      devices ->
        for {address, %{plugged?: true, module: module}} <- devices, do: {address, module}
    end
  end

  defp bus(name) do
    {:ok, pid} = Sim.Server.fetch(name)
    pid
  end

  test "a robot's simulated buses are there as long as it is", %{bus: bus, chip: chip} do
    lines = [bumper: {Sim.Contact, pins: [contact: 17]}]
    robot = start(simulated(bus, [{0x68, @motion}], chip, lines))
    {:ok, handle} = BB.Bus.I2C.open(bus)
    assert BB.Bus.I2C.write_read(handle, 0x68, <<0x75>>, 1) == {:ok, <<0x68>>}

    {:ok, line} = BB.Bus.GPIO.module(nil).open({chip, 17}, :input, pull_mode: :pullup)
    assert Sim.GPIO.read(line) == 1
    :ok = Lines.tell(chip, :bumper, :press)
    assert Sim.GPIO.read(line) == 0

    stop_supervised!(robot)
    assert on(bus) == :bus_not_found
    assert Lines.devices(chip) == {:error, :not_found}
    start(robot)
    assert on(bus) == [{0x68, Sim.Mpu6050}]
  end

  test "two robots share a bus, as they would its wires", %{bus: bus} do
    first = start(simulated(bus, [{0x68, @motion}]))
    second = start(simulated(bus, [{0x40, @rail}]))
    assert on(bus) == [{0x40, Sim.Ina219}, {0x68, Sim.Mpu6050}]
    stop_supervised!(second)
    assert on(bus) == [{0x68, Sim.Mpu6050}]
    start(second)
    # The bus was the first one's: the second makes it anew, with what is its own.
    stop_supervised!(first)
    assert eventually(fn -> on(bus) == [{0x40, Sim.Ina219}] end)
  end

  test "a device that two robots declare is one, until both have gone", %{bus: bus} do
    start(simulated(bus, []))
    lines = [bumper: {Sim.Contact, pins: [contact: 17]}]
    robots = for _ <- 1..2, do: start(simulated(bus, [{0x40, @rail}], bus, lines))
    assert on(bus) == [{0x40, Sim.Ina219}]

    stop_supervised!(hd(robots))
    assert on(bus) == [{0x40, Sim.Ina219}]
    assert %{bumper: %{plugged?: true}} = Lines.devices(bus)

    stop_supervised!(List.last(robots))
    assert on(bus) == []
    assert %{bumper: %{plugged?: false}} = Lines.devices(bus)
  end

  test "another robot's other device at an address fails the start in words", %{bus: bus} do
    first = start(simulated(bus, [{0x40, @rail}]))
    second = simulated(bus, [{0x40, @other_rail}])
    Process.flag(:trap_exit, true)
    assert {:error, error} = second.start_link()
    sentence = BB.Supervisor.format_error(error)
    assert sentence =~ "simulated bus #{bus} has another device at 0x40: a BB.Bus.Sim.Ina219"
    assert sentence =~ "that #{inspect(first)} declares; give #{inspect(second)} another bus"
    assert Process.whereis(second) == nil
    assert on(bus) == [{0x40, Sim.Ina219}]
  end

  test "what somebody else has put on a bus goes before what robots declare", %{bus: bus} do
    start_supervised!({Sim, buses: %{bus => [devices: %{0x40 => @other_rail}]}})
    start_supervised!({Lines, chips: %{bus => [devices: []]}})
    :ok = Lines.plug(bus, :bumper, {Sim.Contact, pins: [contact: 5]})
    lines = [bumper: {Sim.Contact, pins: [contact: 17]}]
    robot = start(simulated(bus, [{0x40, @rail}, {0x68, @motion}], bus, lines))
    assert on(bus) == [{0x40, Sim.Ina219}, {0x68, Sim.Mpu6050}]
    assert %{bumper: %{pins: %{contact: 5}}} = Lines.devices(bus)

    stop_supervised!(robot)
    assert on(bus) == [{0x40, Sim.Ina219}]
    assert %{bumper: %{plugged?: true}} = Lines.devices(bus)
  end

  test "a device that cannot be made fails the start in words", %{bus: bus} do
    Process.flag(:trap_exit, true)
    assert {:error, error} = simulated(bus, [{0x68, {Absent, []}}]).start_link()

    assert BB.Supervisor.format_error(error) =~
             "could not plug in a device at 0x68 of simulated bus #{bus}: :no_recording"
  end

  test "however often a bus is killed, an armed robot notices nothing else", %{bus: bus} do
    robot = start(simulated(bus, [{0x68, @motion}]))
    assert eventually(fn -> health(robot, :brake).state == :up end)
    :ok = BB.Safety.arm(robot)
    before = supervisors(robot)

    for _ <- 1..12 do
      pid = eventually(fn -> match?([_], on(bus)) && bus(bus) end)
      Application.kill(pid)
    end

    assert eventually(fn -> on(bus) == [{0x68, Sim.Mpu6050}] end)
    assert supervisors(robot) == before
    assert BB.Safety.armed?(robot)
    assert Brake.runs(robot, [:brake]) == 0
  end

  test "whichever process of the simulation is killed, the bus comes back", %{bus: bus} do
    robot = start(simulated(bus, [{0x68, @motion}]))
    root = Process.whereis(robot)

    {_id, simulation, _, _} = List.keyfind(Supervisor.which_children(root), :simulation, 0)

    for {path, _pid} <- Application.tree(simulation), path != [] do
      find = fn -> List.keyfind(Application.tree(simulation), path, 0) end
      {^path, pid} = eventually(find)
      Application.kill(pid)
    end

    assert eventually(fn -> on(bus) == [{0x68, Sim.Mpu6050}] end)
    assert Process.whereis(robot) == root
  end

  test "a robot that is killed is started again with its bus", %{bus: bus} do
    robot = simulated(bus, [{0x68, @motion}])
    children = [Supervisor.child_spec(robot, [])]
    start_supervised!(%{id: :above, start: {Supervisor, :start_link, [children, above()]}})

    for _ <- 1..8 do
      pid = eventually(fn -> Process.whereis(robot) end)
      Application.kill(pid)
    end

    assert eventually(fn -> on(bus) == [{0x68, Sim.Mpu6050}] end)
    assert eventually(fn -> up?(robot) end)
  end

  # Between two lives of a robot there is nobody to ask.
  defp up?(robot) do
    health(robot, :brake).state == :up
  rescue
    ArgumentError -> false
  end

  defp above, do: [strategy: :one_for_one, max_restarts: 1_000, max_seconds: 1]

  test "a handler that is called at the robot's end finds the bus", %{bus: bus} do
    robot = start(simulated(bus, [{0x68, @motion}]))
    assert eventually(fn -> health(robot, :brake).state == :up end)
    test = self()

    Brake.script(robot, [:brake],
      disarm: fn _opts ->
        send(test, {:on_the_bus, on(bus)})
        :ok
      end
    )

    :ok = BB.Safety.arm(robot)
    stop_supervised!(robot)
    assert_receive {:on_the_bus, [{0x68, Sim.Mpu6050}]}
  end
end
