defmodule BB.Process.TolerantTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Bus.I2C
  alias BB.Bus.Sim

  @unknown [
    :unknown,
    {:get_childspec, :nobody},
    {:which, :children},
    {:start_child, %{id: :stranger}},
    {{:subscribe_me, :please}, true},
    "text",
    %{},
    [1 | 2],
    nil
  ]

  # Their clauses call the callbacks of components and commands, which have defaults of their own.
  # The simulated bridge answers every call.
  @others [BB.Component.Server, BB.Command.Server, BB.Sim.Bridge]

  # Matches its lines before the request, so it is tested below, with lines.
  @later [BB.Bus.Sim.GPIO.Server]

  defp servers do
    {:ok, modules} = :application.get_key(:ganglion, :modules)

    for module <- modules,
        source = to_string(module.module_info(:compile)[:source]),
        source =~ "/lib/",
        behaviours = Keyword.get_values(module.module_info(:attributes), :behaviour),
        GenServer in List.flatten(behaviours),
        module not in @others,
        do: module
  end

  test "there are the long-lived processes" do
    servers = servers()

    for module <- [
          BB.Safety.Warden,
          BB.Safety.Latch,
          BB.Safety.StopNotice,
          BB.PubSub.Registrar,
          BB.Parameter.Owner,
          BB.Component.Keeper,
          BB.Command.Dispatcher,
          BB.Command.Results,
          BB.Bus.I2C.Server,
          BB.Firmware.Gate,
          BB.Firmware.Guard
        ],
        do: assert(module in servers)
  end

  # With any state: no clause before the last one matches an unknown message.
  test "no unknown call or cast ends any of them" do
    from = {self(), make_ref()}

    for module <- servers() -- @later, unknown <- @unknown do
      assert {:reply, {:error, _reason}, :state} = module.handle_call(unknown, from, :state),
             "#{inspect(module)}: #{inspect(unknown)}"

      assert module.handle_cast(unknown, :state) == {:noreply, :state}
    end
  end

  # Their clauses match the state before the message.
  @listeners [BB.Firmware.Guard, BB.Firmware.Network, BB.Safety.Warden]

  test "no unknown message ends any of them" do
    for module <- servers() -- @listeners,
        unknown <- @unknown,
        do: assert(module.handle_info(unknown, :state) == {:noreply, :state})
  end

  test "a robot's processes, its warden and its buses go on after anything" do
    bus = "i2c-#{System.unique_integer([:positive])}"
    chip = "gpiochip-#{System.unique_integer([:positive])}"
    start_supervised!({Sim, buses: %{bus => [devices: %{0x10 => {Sim.Mpu6050, []}}]}})
    start_supervised!({Sim.Lines, chips: %{chip => []}})
    {:ok, _handle} = I2C.open(bus, backend: Sim.I2C)

    robot = robot(do: sensors(do: sensor(:count, BB.Test.Counter)))
    start_supervised!(robot)
    assert eventually(fn -> health(robot, :count).state == :up end)

    pids = processes(robot, bus, chip)
    for pid <- pids, unknown <- @unknown, do: tell(pid, unknown)
    assert Enum.all?(pids, &Process.alive?/1)
    assert processes(robot, bus, chip) == pids
  end

  # A process that answers has handled all of them.
  defp tell(pid, unknown) do
    GenServer.cast(pid, unknown)
    send(pid, unknown)
    assert {:error, _reason} = GenServer.call(pid, unknown, 60_000)
  end

  defp processes(robot, bus, chip) do
    named =
      for name <- [Safety, PubSub, ParameterOwner, Parameters], do: Module.concat(robot, name)

    {_id, latch, _type, _modules} =
      robot |> Supervisor.which_children() |> List.keyfind(BB.Safety.Latch, 0)

    {:ok, simulated} = Sim.Server.fetch(bus)
    [{shared, _row}] = Registry.lookup(I2C.Supervisor.registry(), {Sim.I2C, bus})
    [{lines, _}] = Registry.lookup(BB.Bus.Sim.GPIO.Registry, chip)
    pids = Enum.map(named, &Process.whereis/1)
    true = Enum.all?(pids, &is_pid/1)

    pids ++
      [
        latch,
        keeper(robot, :count),
        simulated,
        shared,
        lines,
        Process.whereis(BB.Safety.HostWatch)
      ]
  end

  test "a keeper answers as a supervisor, also what it cannot do" do
    robot = robot(do: sensors(do: sensor(:count, BB.Test.Counter)))
    start_supervised!(robot)
    keeper = keeper(robot, :count)
    assert {:ok, %{id: :count, restart: :permanent}} = :supervisor.get_childspec(keeper, :count)
    assert :supervisor.get_childspec(keeper, :nobody) == {:error, :not_found}
    assert {:error, _} = Supervisor.start_child(keeper, {Agent, fn -> nil end})
    assert {:error, _} = Supervisor.terminate_child(keeper, :count)
    assert {:error, _} = Supervisor.restart_child(keeper, :count)
    assert {:error, _} = Supervisor.delete_child(keeper, :count)
    assert [{:count, _pid, :worker, _modules}] = Supervisor.which_children(keeper)
    assert keeper(robot, :count) == keeper
  end
end
