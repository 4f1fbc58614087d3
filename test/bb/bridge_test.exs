defmodule BB.BridgeTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import ExUnit.CaptureIO
  import BB.Test.Robot

  alias BB.Parameter

  defmodule Registers do
    use BB.Bridge,
      options_schema: [owner: [type: :atom, required: true], size: [type: :integer, default: 4]]

    @impl GenServer
    def init(opts) do
      if Process.whereis(opts[:owner]), do: send(opts[:owner], {:init, self(), opts})
      if :persistent_term.get({__MODULE__, opts[:owner]}, nil) == :absent, do: raise_absent(opts)
      {:ok, _} = BB.subscribe(opts[:bb].robot, [:param])
      {:ok, %{robot: opts[:bb].robot, owner: opts[:owner], values: %{speed: 1}}}
    end

    defp raise_absent(_opts), do: exit(:no_device)

    @impl GenServer
    def handle_call(:list_remote, _from, state), do: {:reply, list_remote(state), state}
    def handle_call({:get_remote, id}, _from, state), do: {:reply, get_remote(id, state), state}

    def handle_call({:set_remote, id, value}, _from, state),
      do: {:reply, set_remote(id, value, state), put_in(state.values[id], value)}

    def handle_call({:subscribe_remote, id}, _from, state),
      do: {:reply, subscribe_remote(id, state), state}

    @impl GenServer
    def handle_info({:bb, [:param | _], %{payload: changed}}, state) do
      {:ok, state} = handle_change(state.robot, changed, state)
      {:noreply, state}
    end

    @impl BB.Bridge
    def handle_change(robot, changed, state) do
      send(state.owner, {:changed, robot, changed.path, changed.new_value})
      {:ok, state}
    end

    @impl BB.Bridge
    def list_remote(state) do
      {:ok,
       for(
         {id, value} <- state.values,
         do: %{id: id, value: value, type: :integer, doc: nil, path: [id]}
       )}
    end

    @impl BB.Bridge
    def get_remote(id, state) do
      with :error <- Map.fetch(state.values, id), do: {:error, :unknown}
    end

    @impl BB.Bridge
    def set_remote(_id, _value, _state), do: :ok

    @impl BB.Bridge
    def subscribe_remote(_id, _state), do: :ok
  end

  defmodule HungSchema do
    use BB.Bridge

    @impl BB.Bridge
    def options_schema, do: Process.sleep(:infinity)

    @impl GenServer
    def init(_opts), do: {:ok, nil}

    @impl BB.Bridge
    def handle_change(_robot, _changed, state), do: {:ok, state}
  end

  defmodule HungInit do
    use BB.Bridge

    @impl GenServer
    def init(_opts), do: Process.sleep(:infinity)

    @impl BB.Bridge
    def handle_change(_robot, _changed, state), do: {:ok, state}
  end

  defp robot_with(options, simulation \\ :omit), do: robot_of(Registers, options, simulation)

  defp robot_of(module, options, simulation) do
    create(
      quote do
        parameters do
          param :size, type: :integer, default: 8

          bridge :registers, {unquote(module), unquote(options)}, simulation: unquote(simulation)
        end
      end
    )
  end

  setup do
    owner = :"bridge_#{System.unique_integer([:positive])}"
    Process.register(self(), owner)
    on_exit(fn -> :persistent_term.erase({Registers, owner}) end)
    %{owner: owner}
  end

  test "a bridge is a GenServer of its robot, with its options", %{owner: owner} do
    robot = robot_with(owner: owner, size: quote(do: BB.Parameter.Reference.param([:size])))
    start_supervised!(robot)
    assert_receive {:init, pid, opts}, 5_000
    assert Enum.sort(opts) == [bb: %{robot: robot, path: [:registers]}, owner: owner, size: 8]
    assert BB.Process.whereis(robot, :registers) == pid
    assert %{robot: ^robot} = :sys.get_state(pid)
    assert is_pid(BB.Process.whereis(robot, BB.BridgeSupervisor))
  end

  test "a bridge answers for remote parameters", %{owner: owner} do
    robot = robot_with(owner: owner)
    start_supervised!(robot)
    assert {:ok, [%{id: :speed, value: 1}]} = Parameter.list_remote(robot, :registers)
    assert Parameter.get_remote(robot, :registers, :speed) == {:ok, 1}
    assert Parameter.get_remote(robot, :registers, :size) == {:error, :unknown}
    assert Parameter.set_remote(robot, :registers, :speed, 2) == :ok
    assert Parameter.get_remote(robot, :registers, :speed) == {:ok, 2}
    assert Parameter.subscribe_remote(robot, :registers, :speed) == :ok
  end

  test "a bridge hears of the changes of parameters", %{owner: owner} do
    robot = robot_with(owner: owner)
    start_supervised!(robot)
    :ok = Parameter.set(robot, [:size], 9)
    assert_receive {:changed, ^robot, [:size], 9}, 5_000
  end

  test "wrong options fail the start of the robot", %{owner: owner} do
    capture_io(:stderr, fn -> send(self(), robot_with(owner: owner, sizes: 1)) end)
    assert_received robot when is_atom(robot)
    Process.flag(:trap_exit, true)
    assert {:error, reason} = robot.start_link()
    assert BB.Supervisor.format_error(reason) =~ "unknown options [:sizes]"
    assert BB.Supervisor.format_error(reason) =~ "(in options [:registers])"
  end

  @tag :capture_log
  test "a bridge whose device is absent comes when the device does", %{owner: owner} do
    :persistent_term.put({Registers, owner}, :absent)
    robot = robot_with(owner: owner)
    root = start_supervised!(robot)
    for _ <- 1..5, do: assert_receive({:init, _pid, _opts}, 10_000)
    assert BB.Process.whereis(robot, :registers) == :undefined
    :persistent_term.put({Registers, owner}, :present)
    eventually(fn -> match?({:ok, _}, try_list(robot)) end)
    assert Process.whereis(robot) == root
  end

  for {module, what} <- [{HungSchema, "schema"}, {HungInit, "start"}] do
    @tag :capture_log
    test "a bridge whose #{what} never returns leaves the robot alone" do
      capture_io(:stderr, fn -> send(self(), robot_of(unquote(module), [], :omit)) end)
      assert_received robot when is_atom(robot)
      start_supervised!(robot)
      assert is_pid(BB.Process.whereis(robot, BB.BridgeSupervisor))
    end
  end

  defp try_list(robot) do
    Parameter.list_remote(robot, :registers)
  catch
    :exit, _reason -> :down
  end

  @tag :capture_log
  test "a bridge that crashes again and again comes back alone", %{owner: owner} do
    robot = robot_with(owner: owner)
    root = start_supervised!(robot)
    commands = Process.whereis(BB.Safety.Route.name(robot))

    for _ <- 1..8 do
      pid =
        eventually(fn -> with :undefined <- BB.Process.whereis(robot, :registers), do: nil end)

      ref = Process.monitor(pid)
      Process.exit(pid, :kill)
      assert_receive {:DOWN, ^ref, :process, ^pid, _reason}, 5_000
    end

    eventually(fn -> match?({:ok, _}, try_list(robot)) end)
    assert Process.whereis(robot) == root
    assert Process.whereis(BB.Safety.Route.name(robot)) == commands
  end

  describe "in a simulated robot a bridge" do
    test "is omitted", %{owner: owner} do
      robot = robot_with(owner: owner)
      start_supervised!({robot, simulation: :kinematic})
      assert BB.Process.whereis(robot, :registers) == :undefined
    end

    test "is mocked", %{owner: owner} do
      robot = robot_with([owner: owner], :mock)
      start_supervised!({robot, simulation: :kinematic})
      assert Parameter.list_remote(robot, :registers) == :ok
      pid = BB.Process.whereis(robot, :registers)
      send(pid, :anything)
      GenServer.cast(pid, :anything)
      assert BB.call(robot, :registers, :anything) == :ok
      assert BB.Sim.Bridge.handle_change(robot, nil, :state) == {:ok, :state}
    end

    test "is itself", %{owner: owner} do
      robot = robot_with([owner: owner], :start)
      start_supervised!({robot, simulation: :kinematic})
      assert {:ok, [_]} = Parameter.list_remote(robot, :registers)
    end
  end

  test "a module declares its schema one way" do
    assert_raise CompileError, fn ->
      defmodule Twice do
        use BB.Bridge, options_schema: []
        def options_schema, do: []
        def init(opts), do: {:ok, opts}
      end
    end
  end
end
