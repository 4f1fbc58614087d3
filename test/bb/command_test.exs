defmodule BB.CommandTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually

  alias BB.Command
  alias BB.Command.{Context, Event}
  alias BB.Error.{Category, Invalid, State}
  alias BB.Robot.Runtime
  alias BB.StateMachine.Transition

  # A command that does what its goal and its messages say.
  defmodule Obey do
    use BB.Command, options_schema: [owner: [type: :atom], gain: [type: :any, default: 1]]

    @impl BB.Command
    def handle_command(%{do: :raise}, _context, _state), do: raise("no")
    def handle_command(%{do: :throw}, _context, _state), do: throw(:no)

    def handle_command(%{do: {:stop, reason, result}}, _context, state),
      do: {:stop, reason, %{state | result: result}}

    def handle_command(%{do: {:next, next}}, _context, state), do: {:noreply, state, next}
    def handle_command(%{do: {:return, other}}, _context, _state), do: other

    def handle_command(goal, context, state) do
      if goal[:owner], do: send(goal.owner, {:begun, self(), goal, context, state})
      {:noreply, state}
    end

    @impl BB.Command
    def handle_options(options, state), do: {:ok, %{state | gain: options[:gain]}}

    @impl BB.Command
    def handle_call(:gain, _from, state), do: {:reply, state.gain, state}
    def handle_call(:crash, _from, _state), do: raise("asked to")

    def handle_call({:transition, context, to}, _from, state),
      do: {:reply, BB.Command.transition_state(context, to), state}

    def handle_call(_request, _from, state), do: {:reply, {:error, :not_implemented}, state}

    @impl BB.Command
    def handle_info({:finish, result}, state), do: {:stop, :normal, %{state | result: result}}

    def handle_info(:link, state) do
      spawn_link(fn -> exit(:broken) end)
      {:noreply, state}
    end

    def handle_info(:hang, state) do
      receive do: (:never -> {:noreply, state})
    end

    def handle_info(:timeout, state), do: {:stop, :normal, %{state | result: {:ok, :timed_out}}}

    @impl BB.Command
    def handle_continue(result, state), do: {:stop, :normal, %{state | result: {:ok, result}}}

    @impl BB.Command
    def terminate(reason, %{goal: %{owner: owner}}), do: send(owner, {:terminated, reason})
    def terminate(_reason, _state), do: :ok

    @impl BB.Command
    def result(%{result: :raise}), do: raise("no result")
    def result(%{result: nil}), do: {:error, :interrupted}
    def result(%{result: result}), do: result
  end

  # A command with the defaults alone.
  defmodule Plain do
    use BB.Command

    @impl BB.Command
    def handle_command(_goal, _context, state), do: {:noreply, state}

    @impl BB.Command
    def result(state), do: {:ok, state}
  end

  defmodule Robot do
    use BB

    parameters do
      param :gain, type: :integer, default: 7
    end

    states do
      state :recording, doc: "Writes down what it sees."
    end

    commands do
      category :motion, concurrency_limit: 2, doc: "What moves."
      category :lights

      command :arm do
        handler BB.Command.Arm
        allowed_states [:disarmed]
      end

      command :disarm do
        handler BB.Command.Disarm
        allowed_states [:idle, :recording]
        category :safety
        cancel :*
      end

      command :record, handler: {BB.Command.SetState, to: :recording}
      command :rest, handler: {BB.Command.SetState, to: :idle}, allowed_states: [:recording]

      command :obey, handler: Obey
      command :plain, handler: Plain, category: :lights
      command :move, handler: Obey, category: :motion, allowed_states: :*
      command :jump, handler: Obey, category: :motion, cancel: :motion
      command :stop_all, handler: Obey, category: :lights, cancel: :*
      command :tuned, handler: {Obey, gain: param([:gain])}
      command :wrong, handler: {Obey, gains: 1}
      command :late, handler: Obey, timeout: 20

      command :turn do
        handler Obey
        argument :angle, :float, required: true
        argument :speed, {:in, [:slow, :fast]}, default: :slow
      end

      category :safety
    end

    topology do
      link :base
    end
  end

  # As the generator of Beam Bots writes robots and commands.
  defmodule Generated do
    use BB

    settings do
      name(:generated)
    end

    commands do
      command :arm do
        handler(BB.Command.Arm)
        allowed_states([:disarmed])
      end

      command :disarm do
        handler(BB.Command.Disarm)
        allowed_states([:idle])
      end

      command :greet do
        handler(BB.CommandTest.Greet)
        timeout(:timer.seconds(5))
        allowed_states([:idle])

        argument :who, :string do
          required(true)
          doc("Whom to greet")
        end
      end
    end

    topology do
      link :base_link do
      end
    end
  end

  defmodule Greet do
    use BB.Command

    @impl BB.Command
    def handle_command(goal, _context, state) do
      {:stop, :normal, Map.put(state, :result, {:ok, "Hello, #{goal.who}"})}
    end

    @impl BB.Command
    def result(%{result: result}), do: result
  end

  test "a robot as a generator writes it runs" do
    start_supervised!(Generated)
    assert Runtime.state(Generated) == :disarmed
    assert {:error, %State.NotAllowed{}} = Generated.greet(who: "you")
    {:ok, command} = Generated.arm(%{})
    assert {:ok, :armed, _options} = Command.await(command)
    assert Runtime.state(Generated) == :idle
    {:ok, command} = Generated.greet(%{who: "you"})
    assert Command.await(command) == {:ok, "Hello, you"}
    {:ok, command} = Generated.disarm()
    assert {:ok, :disarmed, _options} = Command.await(command)
    assert BB.Safety.arm(Generated) == :ok
    assert BB.Safety.disarm(Generated) == :ok

    assert [%BB.Dsl.Command{name: :arm, arm: true}, %{disarm: true}, %{name: :greet}] =
             BB.Dsl.Info.commands(Generated)
  end

  setup do
    start_supervised!(Robot)
    on_exit(fn -> BB.Safety.force_disarm(Robot) end)
    :ok
  end

  defp arm, do: :ok = BB.Safety.arm(Robot)

  defp run(name, goal \\ %{}) do
    {:ok, pid} = Runtime.execute(Robot, name, Map.put(goal, :owner, self()))
    assert_receive {:begun, ^pid, _goal, context, state}, 5_000
    {pid, context, state}
  end

  defp eventually_idle, do: eventually(fn -> not Runtime.executing?(Robot) end)

  describe "a robot's commands" do
    test "are functions of its module, which take keywords or a map" do
      assert {:ok, command} = Robot.arm()
      assert {:ok, :armed, next_state: :idle} = Command.await(command)
      assert BB.Safety.armed?(Robot)

      assert {:ok, command} = Robot.turn(angle: "1.5", owner: self())
      assert_receive {:begun, ^command, %{angle: 1.5, speed: :slow}, _context, _state}, 5_000
      Command.cancel(command)
      assert {:error, :interrupted} = Command.await(command)

      assert {:ok, command} = Robot.turn(%{angle: 2.0, speed: "fast", more: 1, owner: self()})
      assert_receive {:begun, ^command, goal, _context, _state}, 5_000
      assert goal == %{angle: 2.0, speed: :fast, more: 1, owner: self()}
      Command.cancel(command)
      assert {:error, :interrupted} = Command.await(command)

      assert {:ok, command} = Robot.disarm()
      assert {:ok, :disarmed, next_state: :disarmed} = Command.await(command)
      assert Runtime.state(Robot) == :disarmed
    end

    test "need their required arguments" do
      arm()
      assert {:error, %Invalid.Command{} = error} = Robot.turn()
      assert %{command: :turn, argument: :angle, value: nil} = error
      assert Exception.message(error) =~ "command :turn, argument :angle: required"
    end

    test "must exist" do
      assert Runtime.execute(Robot, :fly, %{}) == {:error, {:unknown_command, :fly}}
    end

    test "are executed by a robot that is started" do
      stop_supervised!(Robot)
      message = ~r/BB.CommandTest.Robot is not started/
      assert_raise ArgumentError, message, fn -> Robot.obey() end
      assert_raise ArgumentError, message, fn -> Runtime.executing_commands(Robot) end
      assert_raise ArgumentError, message, fn -> Runtime.operational_state(Robot) end
      assert_raise ArgumentError, message, fn -> Runtime.cancel(Robot) end
      assert Runtime.state(Robot) == :disarmed
    end
  end

  describe "a handler" do
    setup do: arm()

    test "has its options, the goal and its context" do
      {pid, context, state} = run(:obey, %{a: 1})

      assert %Context{robot_module: Robot, robot: %BB.Robot{name: Robot}} = context
      assert %BB.Robot.State{} = context.robot_state
      assert [%{execution_id: id, pid: ^pid}] = Runtime.executing_commands(Robot)
      assert context.execution_id == id

      assert state == %{
               bb: %{robot: Robot},
               goal: %{a: 1, owner: self()},
               context: context,
               gain: 1,
               result: nil,
               next_state: nil
             }
    end

    test "has defaults" do
      {:ok, pid} = Robot.plain()
      assert GenServer.call(pid, :anything) == {:error, :not_implemented}
      GenServer.cast(pid, :anything)
      send(pid, :anything)
      Command.cancel(pid)
      assert {:ok, %{result: nil, goal: %{}}} = Command.await(pid)

      assert Plain.handle_continue(1, :state) == {:noreply, :state}
      assert Plain.handle_options([], :state) == {:ok, :state}
      assert Plain.options_schema() == %BB.Options{schema: []}
      shutdown = {:stop, {:shutdown, :disarmed}, :state}
      assert Plain.handle_safety_state_change(:disarming, :state) == shutdown
    end

    test "follows the parameters of its options" do
      {pid, _context, %{gain: 7}} = run(:tuned)
      :ok = BB.Parameter.set(Robot, [:gain], 8)
      assert eventually(fn -> GenServer.call(pid, :gain) == 8 end)
    end

    test "with wrong options fails" do
      {:ok, pid} = Robot.wrong()
      assert {:error, %BB.Options.ValidationError{} = error} = Command.await(pid)
      assert Exception.message(error) =~ "unknown options [:gains]"
    end

    test "returns what a GenServer returns" do
      {:ok, pid} = Robot.obey(do: {:next, 10})
      assert {:ok, :timed_out} = Command.await(pid)

      {:ok, pid} = Robot.obey(do: {:next, {:continue, :further}})
      assert {:ok, :further} = Command.await(pid)

      {:ok, pid} = Robot.obey(do: {:next, :hibernate})
      send(pid, {:finish, {:ok, 1}})
      assert {:ok, 1} = Command.await(pid)
    end

    test "keeps its time-out while others wait for it" do
      {:ok, pid} = Robot.obey(do: {:next, 200})
      assert Command.yield(pid, 1) == nil
      assert {:ok, :timed_out} = Command.await(pid)
    end

    test "cleans up" do
      {pid, _context, _state} = run(:obey)
      send(pid, {:finish, {:ok, 1}})
      assert_receive {:terminated, :normal}, 5_000
    end
  end

  describe "a result" do
    setup do: arm()

    test "is given while the command runs, to all who wait" do
      {pid, _context, _state} = run(:obey)
      waiting = for _ <- 1..3, do: Task.async(fn -> Command.await(pid, 60_000) end)
      eventually(fn -> length(:sys.get_state(pid).waiting) == 3 end)
      send(pid, {:finish, {:ok, 1}})
      assert Task.await_many(waiting, 60_000) == [{:ok, 1}, {:ok, 1}, {:ok, 1}]
    end

    test "is kept after the process has gone, and given once" do
      {:ok, pid} = Robot.obey(do: {:stop, :normal, {:ok, 1}})
      eventually(fn -> not Process.alive?(pid) end)
      assert Command.await(pid) == {:ok, 1}
      assert Command.await(pid) == {:error, {:command_failed, :noproc}}
      assert Command.yield(pid) == {:error, {:command_failed, :noproc}}
    end

    test "is not lost to one who has given up" do
      {pid, _context, _state} = run(:obey)
      assert Command.await(pid, 1) == {:error, {:command_failed, :timeout}}
      assert Command.yield(pid) == nil
      send(pid, {:finish, {:ok, 1}})
      eventually(fn -> not Process.alive?(pid) end)
      refute_received {_ref, {:ok, 1}}
      assert Command.yield(pid) == {:ok, 1}
    end

    test "allows the next command" do
      for n <- 1..50 do
        {:ok, pid} = Robot.obey(do: {:stop, :normal, {:ok, n}})
        assert Command.await(pid) == {:ok, n}
        assert Runtime.state(Robot) == :idle
      end
    end

    test "can be an error" do
      {:ok, pid} = Robot.obey(do: {:stop, :normal, {:error, :blocked}})
      assert Command.await(pid) == {:error, :blocked}

      {:ok, pid} = Robot.obey(do: {:stop, :blocked, {:error, :in_the_way}})
      assert Command.await(pid) == {:error, :in_the_way}
    end

    test "that is none is an error" do
      {:ok, pid} = Robot.obey(do: {:stop, :normal, :done})

      assert {:error, %Invalid.CommandResult{command: Obey, value: :done} = error} =
               Command.await(pid)

      assert Exception.message(error) =~ "result/1 returned :done"

      {:ok, pid} = Robot.obey(do: {:stop, :normal, {:ok, 1, :idle}})
      assert {:error, %Invalid.CommandResult{value: {:ok, 1, :idle}}} = Command.await(pid)

      {:ok, pid} = Robot.obey(do: {:stop, :blocked, :done})
      assert Command.await(pid) == {:error, {:command_failed, :blocked}}
    end

    @tag :capture_log
    test "that cannot be taken is a crash" do
      {:ok, pid} = Robot.obey(do: {:stop, :normal, :raise})
      assert {:error, %State.CommandCrashed{command: :obey} = error} = Command.await(pid)
      assert %RuntimeError{message: "no result"} = error.exception
    end
  end

  describe "a command that crashes" do
    setup do: arm()
    @describetag :capture_log

    test "answers those who wait with the exception" do
      {:ok, pid} = Robot.obey(do: :raise)

      assert {:error, %State.CommandCrashed{command: :obey, exception: exception}} =
               Command.await(pid)

      assert %RuntimeError{message: "no"} = exception

      {:ok, pid} = Robot.obey(do: :throw)
      assert {:error, %State.CommandCrashed{}} = Command.await(pid)

      {:ok, pid} = Robot.obey(do: {:return, :nonsense})
      assert {:error, %State.CommandCrashed{exception: exception}} = Command.await(pid)
      assert exception == {:bad_return_value, :nonsense}

      {pid, _context, _state} = run(:obey)
      catch_exit(GenServer.call(pid, :crash))
      assert {:error, %State.CommandCrashed{exception: %RuntimeError{}}} = Command.await(pid)
    end

    test "by a process that is linked to it" do
      {pid, _context, _state} = run(:obey)
      send(pid, :link)
      assert {:error, %State.CommandCrashed{exception: :broken}} = Command.await(pid)
    end

    test "because it is killed, before and after anyone waits" do
      {pid, _context, _state} = run(:obey)
      waiting = for _ <- 1..2, do: Task.async(fn -> Command.await(pid, 60_000) end)
      eventually(fn -> length(:sys.get_state(pid).waiting) == 2 end)
      Process.exit(pid, :kill)
      crash = {:error, %State.CommandCrashed{command: :obey, exception: :killed}}
      assert Task.await_many(waiting, 60_000) == [crash, crash]
      eventually_idle()

      {pid, _context, _state} = run(:obey)
      Process.exit(pid, :kill)
      eventually_idle()
      assert {:error, %State.CommandCrashed{command: :obey}} = Command.await(pid)
    end

    test "with its supervisor, after which commands run again" do
      {pid, _context, _state} = run(:obey)
      waiting = Task.async(fn -> Command.await(pid, 60_000) end)
      supervisor = BB.Process.whereis(Robot, BB.CommandSupervisor)
      assert DynamicSupervisor.count_children(supervisor).active == 1
      Process.exit(supervisor, :kill)
      assert {:error, %State.CommandCrashed{exception: :killed}} = Task.await(waiting, 60_000)

      eventually(fn ->
        BB.Process.whereis(Robot, BB.CommandSupervisor) not in [supervisor, :undefined]
      end)

      {_pid, _context, _state} = run(:obey)
    end

    test "with the dispatcher, after which commands run again" do
      :ok = Runtime.transition(Robot, :recording)
      {pid, _context, _state} = run(:move)
      waiting = Task.async(fn -> Command.await(pid, 60_000) end)
      eventually(fn -> length(:sys.get_state(pid).waiting) == 1 end)
      name = BB.Safety.Route.name(Robot)
      dispatcher = Process.whereis(name)
      Process.exit(dispatcher, :kill)
      assert Task.await(waiting, 60_000) == {:error, :interrupted}
      eventually(fn -> Process.whereis(name) not in [dispatcher, nil] end)
      eventually(fn -> is_pid(BB.Process.whereis(Robot, BB.CommandSupervisor)) end)
      eventually_idle()
      assert Runtime.state(Robot) == :recording
      {_pid, _context, _state} = run(:move)
    end

    test "with the registry, after which commands run again" do
      registry = Process.whereis(BB.Process.registry_name(Robot))
      Process.exit(registry, :kill)
      start = fn -> match?({:ok, _pid}, try_obey()) end
      assert eventually(start)
    end

    # The registry and the bus of parameters may be about to restart.
    defp try_obey do
      Robot.obey(owner: self())
    rescue
      ArgumentError -> :restarting
    end

    test "often, without end of the robot" do
      root = Process.whereis(Robot)
      name = BB.Safety.Route.name(Robot)

      for _ <- 1..10 do
        pid = eventually(fn -> Process.whereis(name) end)
        ref = Process.monitor(pid)
        Process.exit(pid, :kill)
        assert_receive {:DOWN, ^ref, :process, ^pid, _reason}, 5_000
      end

      eventually(fn -> match?({:ok, _pid}, Robot.obey(owner: self())) end)
      assert Process.whereis(Robot) == root
    end
  end

  describe "an execution ends" do
    setup do: arm()

    test "by being cancelled" do
      {pid, _context, _state} = run(:obey)
      assert Command.cancel(pid) == :ok
      assert_receive {:terminated, {:shutdown, :cancelled}}, 5_000
      assert Command.await(pid) == {:error, :interrupted}
      assert Command.cancel(pid) == :ok
    end

    test "with all others by being cancelled" do
      {one, _context, _state} = run(:obey)
      {other, _context, _state} = run(:move)
      assert Runtime.cancel(Robot) == :ok
      assert Command.await(one) == {:error, :interrupted}
      assert Command.await(other) == {:error, :interrupted}
      assert Runtime.cancel(Robot) == {:error, :no_execution}
    end

    test "when its time is over" do
      {_pid, _context, _state} = run(:late)
      assert_receive {:terminated, {:shutdown, :timeout}}, 5_000
    end

    @tag :capture_log
    test "by a kill when it hangs" do
      {pid, _context, _state} = run(:obey)
      send(pid, :hang)
      Command.cancel(pid)
      assert {:error, %State.CommandCrashed{exception: :killed}} = Command.await(pid, 60_000)
    end

    test "when the robot is not armed any more" do
      {pid, _context, _state} = run(:obey)
      assert BB.Safety.disarm(Robot) == :ok
      assert Command.await(pid) == {:error, :interrupted}
    end

    @tag :capture_log
    test "when the robot is not armed any more, also after a death of the bus" do
      {pid, _context, _state} = run(:obey)
      bus = Process.whereis(Module.concat(Robot, PubSub))
      Process.exit(bus, :kill)
      eventually(fn -> Process.whereis(Module.concat(Robot, PubSub)) not in [bus, nil] end)
      assert BB.Safety.Controller.disarm(Robot) == :ok
      assert_receive {:terminated, {:shutdown, :disarmed}}, 5_000
      assert Command.await(pid) == {:error, :interrupted}
    end

    test "when a handler disarms the robot" do
      {pid, _context, _state} = run(:obey)
      assert BB.Safety.Controller.disarm(Robot) == :ok
      assert_receive {:terminated, {:shutdown, :disarmed}}, 5_000
      assert Command.await(pid) == {:error, :interrupted}
    end
  end

  describe "a command may start" do
    test "in its allowed states" do
      assert {:error, %State.NotAllowed{} = error} = Robot.obey()
      assert %{operation: :obey, current_state: :disarmed, allowed_states: [:idle]} = error
      assert {:ok, _pid} = Robot.move()

      arm()
      assert {:error, %State.NotAllowed{current_state: :idle}} = Robot.arm()
      {:ok, pid} = Robot.record()
      assert {:ok, :recording, next_state: :recording} = Command.await(pid)
      assert {:error, %State.NotAllowed{current_state: :recording}} = Robot.obey()
      assert {:ok, pid} = Robot.rest()
      assert {:ok, :idle, next_state: :idle} = Command.await(pid)
      assert {:ok, _pid} = Robot.obey()
    end

    test "in no state of a robot that is being disarmed or needs a person" do
      arm()
      :ok = BB.Safety.Controller.transition_to_error(Robot)
      assert Robot.move() == {:error, :safety_error}
      assert Runtime.check_allowed(Robot, [:*]) == {:error, :safety_error}
      assert Runtime.state(Robot) == :error
    end

    test "if its category has room" do
      arm()

      assert Runtime.category_availability(Robot) ==
               %{default: {0, 1}, motion: {0, 2}, lights: {0, 1}, safety: {0, 1}}

      {_pid, _context, _state} = run(:obey)
      {_pid, _context, _state} = run(:move)
      {_pid, _context, _state} = run(:move)
      assert {:error, %Category.Full{} = error} = Robot.move()
      assert %{category: :motion, limit: 2, current: 2} = error
      assert {:error, %Category.Full{category: :default, limit: 1}} = Robot.obey()
      assert Runtime.category_availability(Robot).motion == {2, 2}
      assert Runtime.executing?(Robot)
      assert Runtime.executing?(Robot, :motion)
      refute Runtime.executing?(Robot, :lights)

      assert [%{name: :obey, category: :default}, %{name: :move} = second, %{name: :move}] =
               Runtime.executing_commands(Robot)

      assert Map.keys(second) == [:category, :execution_id, :name, :pid, :started_at]
    end

    test "after the executions that it preempts have ended" do
      arm()
      {one, _context, _state} = run(:move)
      {other, _context, _state} = run(:move)
      {kept, _context, _state} = run(:obey)
      {_jump, _context, _state} = run(:jump)
      assert Command.await(one) == {:error, :interrupted}
      assert Command.await(other) == {:error, :interrupted}
      assert Command.yield(kept) == nil

      {_stop, _context, _state} = run(:stop_all)
      assert [%{name: :stop_all}] = Runtime.executing_commands(Robot)
      assert Command.await(kept) == {:error, :interrupted}
    end

    test "instead of one of its own that hangs" do
      arm()
      {pid, _context, _state} = run(:jump)
      send(pid, :hang)
      tasks = for _ <- 1..3, do: Task.async(fn -> Robot.jump() end)
      assert [{:ok, _}, {:ok, _}, {:ok, _}] = Task.await_many(tasks, 60_000)
      eventually(fn -> match?([%{name: :jump}], Runtime.executing_commands(Robot)) end)
    end
  end

  describe "the events of an execution" do
    setup do
      arm()
      {:ok, _} = BB.subscribe(Robot, [:command])
      :ok
    end

    test "tell its beginning and its success" do
      {pid, %{execution_id: id}, _state} = run(:obey)
      assert_receive {:bb, [:command, :obey, ^id], started}, 5_000
      assert %{frame_id: :command, payload: %Event{status: :started, data: data}} = started
      assert data == %{goal: %{owner: self()}}
      send(pid, {:finish, {:ok, 1, next_state: :recording}})
      assert_receive {:bb, [:command, :obey, ^id], %{payload: ended}}, 5_000
      assert ended == %Event{status: :succeeded, data: %{result: 1}}
      assert Command.await(pid) == {:ok, 1, next_state: :recording}
    end

    test "tell its failure" do
      {pid, %{execution_id: id}, _state} = run(:obey)
      send(pid, {:finish, {:error, :blocked}})
      assert_receive {:bb, [:command, :obey, ^id], %{payload: %{status: :failed} = event}}, 5_000
      assert event.data == %{reason: :blocked}

      {pid, %{execution_id: id}, _state} = run(:obey)
      Process.exit(pid, :kill)
      assert_receive {:bb, [:command, :obey, ^id], %{payload: %{status: :failed} = event}}, 5_000
      assert %{reason: %State.CommandCrashed{exception: :killed}} = event.data
    end
  end

  describe "the state of a robot" do
    setup do
      arm()
      {:ok, _} = BB.subscribe(Robot, [:state_machine])
      :ok
    end

    defp assert_transition(from, to) do
      assert_receive {:bb, [:state_machine], %{payload: transition}}, 5_000
      assert transition == %Transition{from: from, to: to}
    end

    test "is :executing while commands run in :idle" do
      assert Runtime.state(Robot) == :idle
      {one, _context, _state} = run(:obey)
      {other, _context, _state} = run(:move)
      assert Runtime.state(Robot) == :executing
      assert Runtime.operational_state(Robot) == :idle
      assert_transition(:idle, :executing)
      send(one, {:finish, {:ok, 1}})
      assert Command.await(one) == {:ok, 1}
      assert Runtime.state(Robot) == :executing
      send(other, {:finish, {:ok, 1, next_state: :recording}})
      assert_transition(:executing, :recording)
      assert Runtime.state(Robot) == :recording
    end

    test "is changed by hand, to a state that the robot has" do
      assert Runtime.transition(Robot, :recording) == :ok
      assert_transition(:idle, :recording)
      assert {:error, %State.Invalid{} = error} = Runtime.transition(Robot, :flying)
      assert %{state: :flying, valid_states: [:idle, :recording]} = error
      assert Runtime.check_allowed(Robot, [:recording]) == :ok
      assert {:error, %State.NotAllowed{}} = Runtime.check_allowed(Robot, [:idle])
    end

    test "is not set to a state that does not exist" do
      context = %Context{robot_module: Robot, execution_id: make_ref()}
      state = %{to: :nowhere, result: nil, next_state: nil}
      assert {:stop, :normal, state} = Command.SetState.handle_command(%{}, context, state)
      assert {:error, %State.Invalid{state: :nowhere}} = Command.SetState.result(state)
      assert {:error, :interrupted} = Command.SetState.result(%{result: nil})
    end

    test "is changed by a command that runs, and by no other" do
      {pid, context, _state} = run(:obey)
      assert_transition(:idle, :executing)
      assert GenServer.call(pid, {:transition, context, :recording}) == :ok
      assert_transition(:executing, :recording)
      assert {:error, %State.Invalid{}} = GenServer.call(pid, {:transition, context, :flying})
      Command.cancel(pid)
      Command.await(pid)
      assert Command.transition_state(context, :idle) == {:error, :not_executing}
    end

    test "is kept while the robot is disarmed, and begins anew when it is armed" do
      :ok = Runtime.transition(Robot, :recording)
      :ok = BB.Safety.disarm(Robot)
      assert Runtime.state(Robot) == :disarmed
      assert Runtime.operational_state(Robot) == :recording
      arm()
      assert Runtime.operational_state(Robot) == :idle
    end

    test "ignores a next state that does not exist" do
      {pid, _context, _state} = run(:obey)

      log =
        ExUnit.CaptureLog.capture_log(fn ->
          send(pid, {:finish, {:ok, 1, next_state: :flying}})
          assert Command.await(pid) == {:ok, 1, next_state: :flying}
        end)

      assert log =~ "command :obey ended with the unknown next_state :flying"
      assert Runtime.state(Robot) == :idle
    end
  end
end
