defmodule BB.Safety.RouteTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.{Command, Safety}
  alias BB.Robot.Runtime
  alias BB.Safety.Controller

  # Arms or disarms as its options say, after it has told the owner.
  defmodule Careful do
    use BB.Command, options_schema: [owner: [type: :atom], as: [type: :atom, required: true]]

    @impl BB.Command
    def handle_command(_goal, %{robot_module: robot}, state) do
      if Process.whereis(state.owner), do: send(state.owner, {:careful, self(), state.as})
      act(state.as, robot, state)
    end

    defp act(:arm, robot, state), do: finish(Controller.arm(robot), state)
    defp act(:disarm, robot, state), do: finish(Controller.disarm(robot), state)
    defp act(:by_safety, robot, state), do: finish(BB.Safety.disarm(robot), state)
    defp act(:nothing, _robot, state), do: finish({:ok, :parked}, state)
    defp act(:fail, _robot, state), do: finish({:error, :stuck}, state)
    defp act(:crash, _robot, _state), do: raise("stuck")
    defp act(:wait, _robot, state), do: {:noreply, state}

    defp finish(result, state), do: {:stop, :normal, %{state | result: result}}

    @impl BB.Command
    def handle_info({:finish, result}, state), do: finish(result, state)

    @impl BB.Command
    def result(%{result: :ok}), do: {:ok, :done}
    def result(%{result: nil}), do: {:error, :interrupted}
    def result(%{result: result}), do: result
  end

  defmodule Brake do
    use BB.Actuator, options_schema: [owner: [type: :atom]]

    @impl BB.Actuator
    def init(opts), do: {:ok, opts}

    @impl BB.Actuator
    def handle_command(_message, state), do: {:noreply, state}

    @impl BB.Actuator
    def disarm(opts) do
      if Process.whereis(opts[:owner]), do: send(opts[:owner], :braked)
      :ok
    end
  end

  # A robot whose arm and disarm commands act so.
  defp start(arm, disarm, fields \\ []) do
    owner = :"route_#{System.unique_integer([:positive])}"
    Process.register(self(), owner)

    robot =
      create(
        quote do
          commands do
            command :ready, [
              {:handler, {unquote(Careful), owner: unquote(owner), as: unquote(arm)}},
              {:allowed_states, [:disarmed]},
              {:arm, true}
            ]

            command :park, [
              {:handler, {unquote(Careful), owner: unquote(owner), as: unquote(disarm)}},
              {:disarm, true} | unquote(fields)
            ]

            command :work, handler: {unquote(Careful), owner: unquote(owner), as: :wait}
          end

          topology do
            link :base do
              joint :wheel, type: :continuous do
                actuator :brake, {unquote(Brake), owner: unquote(owner)}
                link :rim
              end
            end
          end
        end
      )

    start_supervised!(robot)
    eventually(fn -> match?([%{state: :up}], BB.Actuator.health(robot)) end)
    on_exit(fn -> Safety.force_disarm(robot) end)
    robot
  end

  test "a robot is armed and disarmed by its commands" do
    robot = start(:arm, :disarm)
    assert Safety.arm(robot) == :ok
    assert_received {:careful, _pid, :arm}
    assert Safety.armed?(robot)
    assert Safety.arm(robot) == {:error, :already_armed}
    refute_received {:careful, _pid, :arm}

    assert Safety.disarm(robot) == :ok
    assert_received {:careful, _pid, :disarm}
    assert_received :braked
    assert Safety.state(robot) == :disarmed
    assert Safety.disarm(robot) == {:error, :already_disarmed}
    refute_received {:careful, _pid, :disarm}
  end

  test "BB.Safety.Controller calls no command" do
    robot = start(:fail, :fail)
    assert Controller.arm(robot) == :ok
    assert Controller.disarm(robot) == :ok
    assert_received :braked
    refute_received {:careful, _pid, _as}
  end

  test "an arm command that fails leaves the robot disarmed" do
    robot = start(:fail, :disarm)
    assert Safety.arm(robot) == {:error, :stuck}
    assert Safety.state(robot) == :disarmed

    robot = start_other(:nothing, :disarm)
    assert Safety.arm(robot) == {:error, {:arm_command_failed, :not_armed}}
    assert Safety.state(robot) == :disarmed
  end

  # With another name of the test's process.
  defp start_other(arm, disarm) do
    {:registered_name, name} = Process.info(self(), :registered_name)
    Process.unregister(name)
    start(arm, disarm)
  end

  test "an inhibition forbids arming by the command" do
    robot = start(:arm, :disarm)
    Safety.inhibit(robot, [:lid], :open)
    assert Safety.arm(robot) == {:error, {:inhibited, [{[:lid], :open}]}}
    Safety.allow(robot, [:lid])
    assert Safety.arm(robot) == :ok
  end

  @tag :capture_log
  test "when the disarm command fails, the hardware is made safe, and the robot is in error" do
    for disarm <- [:fail, :crash] do
      robot = if disarm == :fail, do: start(:arm, disarm), else: start_other(:arm, disarm)
      :ok = Safety.arm(robot)
      assert {:error, {:disarm_command_failed, reason}} = Safety.disarm(robot)

      if disarm == :fail,
        do: assert(reason == :stuck),
        else: assert(%BB.Error.State.CommandCrashed{command: :park} = reason)

      assert_received :braked
      assert Safety.state(robot) == :error
      assert Safety.disarm(robot) == {:error, :already_in_error}
      assert Safety.force_disarm(robot) == :ok
    end
  end

  test "when the disarm command cannot start, the hardware is made safe, and the robot is in error" do
    robot = start(:arm, :disarm)
    :ok = Safety.arm(robot)
    {:ok, work} = Runtime.execute(robot, :work)
    assert {:error, {:disarm_command_failed, reason}} = Safety.disarm(robot)
    assert %BB.Error.Category.Full{category: :default} = reason
    assert_received :braked
    assert Safety.state(robot) == :error
    assert Command.await(work) == {:error, :interrupted}
  end

  test "a disarm command preempts what it cancels" do
    robot = start(:arm, :disarm, cancel: :*)
    :ok = Safety.arm(robot)
    {:ok, work} = Runtime.execute(robot, :work)
    assert Safety.disarm(robot) == :ok
    assert Command.await(work) == {:error, :interrupted}
  end

  test "a disarm command that only parks leaves the rest to the handlers" do
    robot = start(:arm, :nothing)
    :ok = Safety.arm(robot)
    assert Safety.disarm(robot) == :ok
    assert_received :braked
    assert Safety.state(robot) == :disarmed
  end

  test "a disarm command may call BB.Safety.disarm/1" do
    robot = start(:arm, :by_safety)
    :ok = Safety.arm(robot)
    assert Safety.disarm(robot) == :ok
    assert_received :braked
  end

  test "all who disarm at once wait for the same command" do
    robot = start(:arm, :wait)
    :ok = Safety.arm(robot)
    {:ok, park} = Runtime.execute(robot, :park)
    callers = for _ <- 1..3, do: Task.async(fn -> Safety.disarm(robot) end)
    dispatcher = Process.whereis(Safety.Route.name(robot))

    eventually(fn ->
      [execution] = Map.values(:sys.get_state(dispatcher).running)
      length(execution.callers) == 3
    end)

    :ok = Controller.disarm(robot)
    send(park, {:finish, :ok})
    assert Task.await_many(callers, 60_000) == [:ok, :ok, :ok]
  end

  test "a disarm command that does not end in its time fails" do
    robot = start(:arm, :wait, timeout: 50)
    :ok = Safety.arm(robot)
    assert Safety.disarm(robot) == {:error, {:disarm_command_failed, :interrupted}}
    assert_received :braked
    assert Safety.state(robot) == :error
  end

  @tag :capture_log
  test "when the dispatcher dies, the hardware is made safe, and the robot is in error" do
    robot = start(:arm, :wait)
    :ok = Safety.arm(robot)
    caller = Task.async(fn -> Safety.disarm(robot) end)
    assert_receive {:careful, _pid, :wait}, 5_000
    Process.exit(Process.whereis(Safety.Route.name(robot)), :kill)
    assert {:error, {:disarm_command_failed, :killed}} = Task.await(caller, 60_000)
    assert_received :braked
    assert Safety.state(robot) == :error
  end

  test "a handler that arms or disarms sets the flag of its command" do
    robot =
      robot do
        commands do
          command :wake, handler: BB.Command.Arm, allowed_states: [:disarmed]
          command :sleep, handler: BB.Command.Disarm
        end
      end

    start_supervised!(robot)
    {:ok, _} = BB.subscribe(robot, [:command])
    assert robot.__bb_arm_command__() == :wake
    assert robot.__bb_disarm_command__() == :sleep
    assert Safety.arm(robot) == :ok
    assert_receive {:bb, [:command, :wake, _id], %{payload: %{status: :succeeded} = event}}, 5_000
    assert event.data == %{result: :armed}
    assert Safety.disarm(robot) == :ok

    assert_receive {:bb, [:command, :sleep, _id], %{payload: %{status: :succeeded} = event}},
                   5_000

    assert event.data == %{result: :disarmed}
  end
end
