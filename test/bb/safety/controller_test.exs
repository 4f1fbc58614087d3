defmodule BB.Safety.ControllerTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Safety
  alias BB.Safety.Controller
  alias BB.Test.Brake

  defp unique, do: Module.concat(__MODULE__, "Robot#{System.unique_integer([:positive])}")

  defp registered do
    robot = unique()
    :ok = Controller.register_robot(robot)
    robot
  end

  test "a robot that is registered is disarmed, and can be armed and disarmed" do
    robot = registered()
    assert Controller.register_robot(robot) == :ok
    assert Controller.state(robot) == :disarmed
    assert Controller.epoch(robot) == :error
    assert Controller.arm(robot) == :ok
    assert Controller.armed?(robot) and Safety.armed?(robot)
    assert Controller.epoch(robot) == Safety.epoch(robot)
    assert Controller.arm(robot) == {:error, :already_armed}
    assert Controller.disarm(robot) == :ok
    assert Controller.disarm(robot, timeout: 100) == {:error, :already_disarmed}
    refute Controller.in_error?(robot) or Controller.disarming?(robot)
    assert Controller.force_disarm(robot) == {:error, :not_in_error}
    assert_raise ArgumentError, fn -> Controller.disarm(robot, timeout: 0) end
  end

  test "a robot that is not registered" do
    assert Controller.arm(unique()) == {:error, :not_registered}
    assert Controller.transition_to_error(unique()) == {:error, :not_registered}
    assert Controller.registered_handlers(unique()) == []
  end

  test "the registered handlers are modules, one for each path" do
    robot = registered()
    :ok = Controller.register(Brake, robot: robot, path: [:a])
    :ok = Controller.register(Brake, robot: robot, path: [:b])
    :ok = Controller.register(BB.Test.Caliper, robot: robot, path: [:b])
    assert Enum.sort(Controller.registered_handlers(robot)) == [Brake, BB.Test.Caliper]
  end

  test "a topology supervisor that dies leaves an armed robot in error" do
    robot = registered()
    Brake.register(robot, [:a])
    topology = topology_of(robot)
    :ok = Controller.arm(robot)
    Process.exit(topology, :kill)
    assert eventually(fn -> Controller.in_error?(robot) end)
    assert Brake.runs(robot, [:a]) == 1
    assert Controller.arm(robot) == {:error, :in_error}
    assert Controller.force_disarm(robot) == :ok
  end

  test "a topology supervisor that takes the place of a living one changes nothing" do
    robot = registered()
    first = topology_of(robot)
    :ok = Controller.arm(robot)
    second = topology_of(robot)
    assert Controller.armed?(robot)
    ref = Process.monitor(first)
    Process.exit(first, :kill)
    assert_receive {:DOWN, ^ref, :process, ^first, :killed}

    # The warden has handled what it received before this call.
    assert Controller.arm(robot) == {:error, :already_armed}
    Process.exit(second, :kill)
    assert eventually(fn -> Controller.in_error?(robot) end)
  end

  test "an error is reported on [:safety, :error]" do
    robot = robot(do: sensors(do: sensor(:a, BB.Test.Brake)))
    start_supervised!(robot)
    {:ok, _} = BB.subscribe(robot, [:safety, :error])
    :ok = Controller.report_error(robot, [:a], :hot)
    assert_receive {:bb, [:safety, :error], %{payload: %{path: [:a], error: :hot}}}
  end

  describe "transition_to_error/1" do
    test "runs the handlers of an armed robot, and ends in error although all succeed" do
      robot = registered()
      Brake.register(robot, [:a])
      assert Controller.transition_to_error(robot) == {:error, :already_disarmed}
      :ok = Controller.arm(robot)
      assert Controller.transition_to_error(robot) == :ok
      assert {Controller.state(robot), Brake.runs(robot, [:a])} == {:error, 1}
      assert Controller.transition_to_error(robot) == :ok
      assert Brake.runs(robot, [:a]) == 1
    end

    test "returns the result of a disarming that is under way" do
      for {answer, state, expected} <- [
            {:ok, :disarmed, {:error, :already_disarmed}},
            {{:error, :stuck}, :error, :ok}
          ] do
        robot = registered()
        test = self()

        Brake.script(robot, [:a],
          disarm: fn _opts ->
            send(test, {:runs, self()})
            receive do: (:go_on -> answer)
          end
        )

        Brake.register(robot, [:a])
        :ok = Controller.arm(robot)
        disarming = Task.async(fn -> Controller.disarm(robot, timeout: 60_000) end)
        assert_receive {:runs, handler}, 30_000
        transition = Task.async(fn -> Controller.transition_to_error(robot) end)
        send(handler, :go_on)
        _outcome = Task.await(disarming, :infinity)
        assert Task.await(transition, :infinity) == expected
        assert Controller.state(robot) == state
      end
    end
  end

  defp topology_of(robot) do
    test = self()

    topology =
      spawn(fn ->
        send(test, {:topology, self(), Controller.register_topology_supervisor(robot)})
        Process.sleep(:infinity)
      end)

    assert_receive {:topology, ^topology, :ok}, 30_000
    topology
  end
end
