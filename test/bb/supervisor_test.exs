defmodule BB.SupervisorTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
  import BB.Test.Watch

  alias BB.Options.ValidationError
  alias BB.Test.{Counter, Probe}

  doctest BB.Supervisor

  describe "the tree" do
    test "holds the robot's sensors, its link, that link's sensors and joints, and so on" do
      robot =
        robot do
          sensors do
            sensor :battery, BB.Test.Probe
          end

          topology do
            link :base do
              sensor :imu, BB.Test.Probe

              joint :elbow do
                type :fixed
                sensor :encoder, BB.Test.Probe

                link :arm do
                  sensor :touch, BB.Test.Probe
                end
              end
            end
          end
        end

      start_supervised!(robot)
      topology = [robot, BB.TopologySupervisor]
      base = topology ++ [{:link, :base}]

      assert Enum.sort(for {id, _pid} <- supervisors(robot), do: id) ==
               Enum.sort([
                 [robot],
                 topology,
                 topology ++ [BB.SensorSupervisor],
                 topology ++ [BB.SensorSupervisor, {:sensor, :battery}],
                 topology ++ [BB.ControllerSupervisor],
                 base,
                 base ++ [{:sensor, :imu}],
                 base ++ [{:joint, :elbow}],
                 base ++ [{:joint, :elbow}, {:sensor, :encoder}],
                 base ++ [{:joint, :elbow}, {:link, :arm}],
                 base ++ [{:joint, :elbow}, {:link, :arm}, {:sensor, :touch}]
               ])

      for name <- [:battery, :imu, :encoder, :touch], do: assert(is_pid(pid(robot, name)))
    end

    test "has the root under the robot's name, and started twice says so" do
      robot = one_of_three()
      root = start_supervised!(robot)
      assert Process.whereis(robot) == root
      assert robot.start_link() == {:error, {:already_started, root}}
    end

    test "has under the root process registry, pubsub, runtime and topology supervisor, started in this order" do
      robot = one_of_three()
      root = start_supervised!(robot)

      children =
        for {id, pid, _, _} <- Enum.reverse(Supervisor.which_children(root)),
            do: {id, Process.info(pid, :registered_name)}

      assert [registry, bus, {:runtime, _}, _latch, tasks, topology | rest] = children
      assert [{BB.BridgeSupervisor, _}, commands, _notice] = rest
      assert {BB.Command.Supervisor, _} = commands
      assert {BB.Supervisor.Tasks, _} = tasks
      assert {BB.TopologySupervisor, _} = topology
      assert {_, {:registered_name, name}} = registry
      assert name == BB.Process.registry_name(robot)
      assert {{BB.PubSub, ^robot}, _} = bus
    end

    test "has supervisors in the robot's registry, and tasks for anybody" do
      robot = start_up(one_of_three())
      topology = BB.Process.whereis(robot, BB.TopologySupervisor)
      assert {_, ^topology, _, _} = find_child(robot, BB.TopologySupervisor)

      for name <- [BB.SensorSupervisor, BB.ControllerSupervisor] do
        pid = BB.Process.whereis(robot, name)
        assert {^name, ^pid, :supervisor, _} = find_child(topology, name)
      end

      test = self()
      tasks = BB.Process.via(robot, BB.TaskSupervisor)
      {:ok, _} = Task.Supervisor.start_child(tasks, fn -> send(test, {:task, self()}) end)
      assert_receive {:task, _pid}
      assert Task.Supervisor.async(tasks, fn -> 7 end) |> Task.await() == 7
    end

    test "gives supervisors and tasks their names again when they were killed" do
      robot = start_up(one_of_three())

      for name <- [BB.SensorSupervisor, BB.TaskSupervisor, BB.TopologySupervisor] do
        pid = BB.Process.whereis(robot, name)
        Process.exit(pid, :kill)
        assert eventually(fn -> BB.Process.whereis(robot, name) not in [pid, :undefined] end)
      end

      assert BB.Test.Robot.await_all_up(robot)
    end

    test "has tasks again after the death of the registry" do
      robot = start_up(one_of_three())
      pid = BB.Process.whereis(robot, BB.TaskSupervisor)
      registry = Process.whereis(BB.Process.registry_name(robot))
      Process.exit(registry, :kill)

      assert eventually(fn -> whereis(robot, BB.TaskSupervisor) not in [pid, :undefined] end)
      tasks = BB.Process.via(robot, BB.TaskSupervisor)
      assert Task.Supervisor.async(tasks, fn -> 7 end) |> Task.await() == 7
    end

    defp whereis(robot, name) do
      BB.Process.whereis(robot, name)
    rescue
      # The registry is being restarted.
      ArgumentError -> :undefined
    end

    defp find_child(supervisor, id),
      do: supervisor |> Supervisor.which_children() |> List.keyfind(id, 0)

    test "starts controllers before the actuators that call them in init/1" do
      robot =
        robot do
          controllers do
            controller :bus, BB.Test.Brain
          end

          topology do
            link :base do
              joint :elbow do
                type :continuous
                actuator :servo, BB.Test.Servo
                link :arm
              end
            end
          end
        end

      BB.Test.Servo.observe(robot)
      test = self()

      BB.Test.Servo.script(robot, :servo,
        init: fn state ->
          send(test, {:answer, BB.Process.call(robot, :bus, :options)})
          {:ok, state}
        end
      )

      start_supervised!(robot)
      assert_receive {:answer, [_ | _]}
      assert [%{restarts: 0}] = BB.Actuator.health(robot)
    end

    test "is one_for_one: what dies takes nothing else of the robot's parts with it" do
      robot = start_up(one_of_three())

      for part <- [:runtime, BB.TopologySupervisor] do
        before = parts(robot)
        Process.exit(before[part], :kill)
        assert eventually(fn -> parts(robot)[part] not in [before[part], :restarting] end)
        assert Map.delete(parts(robot), part) == Map.delete(before, part)
      end
    end

    defp parts(robot) do
      for {id, pid, _, _} <- Supervisor.which_children(robot), into: %{}, do: {id, pid}
    end

    @tag :capture_log
    test "starts each process below the root once more when it is killed, and the root lives" do
      robot = one_of_three()
      root = start_supervised!(robot)

      for {id, _pid, _type, _modules} <- Supervisor.which_children(root) do
        # Each kill is the only one within the root's period.
        root = restart(robot)
        pid = child(root, id)
        Process.exit(pid, :kill)
        assert eventually(fn -> child(root, id) not in [pid, :restarting, :undefined] end)
        assert Process.whereis(robot) == root, "the end of #{inspect(id)} ended the robot"
      end
    end

    test "is one_for_one at every link and joint: what dies takes only what it carries with it" do
      robot =
        robot do
          topology do
            link :base do
              sensor :imu, BB.Test.Probe

              joint :left do
                type :fixed
                sensor :encoder, BB.Test.Probe

                link :hand do
                  sensor :touch, BB.Test.Probe
                end
              end

              joint :right do
                type :fixed
                sensor :other, BB.Test.Probe
                link :foot
              end
            end
          end
        end

      start_supervised!(robot)
      assert BB.Test.Robot.await_all_up(robot)

      for {part, carried} <- [{{:link, :hand}, [:touch]}, {{:joint, :left}, [:encoder, :touch]}] do
        before = pids(robot)
        {_id, victim} = Enum.find(supervisors(robot), fn {id, _pid} -> List.last(id) == part end)
        Process.exit(victim, :kill)

        assert eventually(fn ->
                 Enum.all?(carried, &(pids(robot)[&1] not in [before[&1], :undefined]))
               end)

        assert Map.drop(pids(robot), carried) == Map.drop(before, carried)
      end
    end

    defp pids(robot),
      do: for(name <- [:imu, :encoder, :touch, :other], into: %{}, do: {name, pid(robot, name)})

    test "shows each sensor under its keeper, as a supervisor's child" do
      robot = start_up(one_of_three())
      keeper = keeper(robot, :imu)
      imu = pid(robot, :imu)
      assert [{:imu, ^imu, :worker, _}] = Supervisor.which_children(keeper)
      assert %{active: 1, specs: 1, workers: 1} = Supervisor.count_children(keeper)
    end
  end

  defp restart(robot) do
    stop_supervised!(robot)
    start_supervised!(robot)
  end

  defp child(root, id), do: root |> Supervisor.which_children() |> List.keyfind(id, 0) |> elem(1)

  describe "wrong options" do
    test "fail the start of the robot with the validation error, and start nothing" do
      robot =
        robot do
          topology do
            link :base do
              sensor :imu, {BB.Test.Probe, rtae: 100}
            end
          end
        end

      assert {:error, %ValidationError{} = error} = robot.start_link()

      assert Exception.message(error) ==
               "unknown options [:rtae], valid options are: [:rate] (in options [:base, :imu])"

      assert Process.whereis(robot) == nil
      assert Process.whereis(BB.Process.registry_name(robot)) == nil
    end

    test "under a supervisor are a sentence too" do
      robot =
        robot do
          sensors do
            sensor :imu, {BB.Test.Probe, rate: 0}
          end
        end

      Process.flag(:trap_exit, true)
      {:error, reason} = Supervisor.start_link([robot], strategy: :one_for_one)

      assert BB.Supervisor.format_error(reason) ==
               "invalid value for :rate option: expected positive integer, got: 0 (in options [:imu])"
    end

    test "of the robot itself fail its start too" do
      assert {:error, %ValidationError{} = error} = one_of_three().start_link(speed: 3)
      assert Exception.message(error) =~ "unknown options [:speed]"
    end
  end

  describe "a fault of one sensor never reaches another:" do
    test "hundreds are killed, and no sibling misses a message or changes its pid, nor does a supervisor" do
      names = for n <- 1..60, do: :"faulty_#{n}"

      robot =
        create(
          quote do
            sensors do
              sensor :first, BB.Test.Counter
              for name <- unquote(names), do: sensor(name, BB.Test.Probe)
            end

            topology do
              link :base do
                sensor :second, BB.Test.Counter
              end
            end
          end
        )

      start_supervised!(robot)
      assert BB.Test.Robot.await_all_up(robot)
      {:ok, _} = BB.subscribe(robot, [:sensor, :first])
      {:ok, _} = BB.subscribe(robot, [:sensor, :base, :second])
      supervisors = supervisors(robot)
      siblings = {pid(robot, :first), pid(robot, :second)}
      counts = {first_count(:first), first_count(:second)}

      {first, second} =
        Enum.reduce(1..5, counts, fn _round, {first, second} ->
          before = for name <- names, do: pid(robot, name)
          Enum.each(before, &Process.exit(&1, :kill))
          counts = {count_on(:first, first, 50), count_on(:second, second, 50)}

          assert eventually(fn ->
                   Enum.all?(Enum.zip(names, before), fn {name, old} ->
                     pid(robot, name) not in [old, :undefined]
                   end)
                 end)

          counts
        end)

      count_on(:first, first, 10)
      count_on(:second, second, 10)
      assert {pid(robot, :first), pid(robot, :second)} == siblings
      assert supervisors(robot) == supervisors
      assert BB.Test.Robot.await_all_up(robot)

      for row <- BB.Sensor.health(robot), row.name in names, do: assert(row.restarts == 5)
    end

    test "one that cannot come up changes nothing for the others" do
      robot = one_of_three()
      imu(robot, init: fn _ -> exit(:broken) end)
      start_watched(robot)
      supervisors = supervisors(robot)
      {:ok, _} = BB.subscribe(robot, [:sensor, :first])
      from = first_count(:first)
      assert eventually(fn -> health(robot, :imu).restarts >= 4 end)
      count_on(:first, from, 100)
      assert supervisors(robot) == supervisors
    end
  end

  describe "when the robot stops," do
    test "terminate runs in each sensor, the last declared first" do
      robot =
        robot do
          topology do
            link :base do
              sensor :a, BB.Test.Probe
              sensor :b, BB.Test.Probe

              joint :j do
                type :fixed
                sensor :c, BB.Test.Probe
                link :tip
              end
            end
          end
        end

      test = self()

      for name <- [:a, :b, :c] do
        Probe.script(robot, name,
          terminate: fn reason, _ -> send(test, {:terminated, name, reason}) end
        )
      end

      start_supervised!(robot)
      assert BB.Test.Robot.await_all_up(robot)
      stop_supervised!(robot)

      assert {:messages,
              [
                {:terminated, :c, :shutdown},
                {:terminated, :b, :shutdown},
                {:terminated, :a, :shutdown}
              ]} = Process.info(self(), :messages)
    end

    test "no process and no alarm are left" do
      robot = one_of_three()
      imu(robot, init: fn _ -> {:stop, :absent} end)
      start_watched(robot)
      assert eventually(fn -> alarm(robot, [:base, :imu]) end)
      refs = monitor_all(robot)
      BB.unsubscribe(robot, [:sensor_status])
      stop_supervised!(robot)
      for ref <- refs, do: assert_received({:DOWN, ^ref, _, _, _})
      assert alarm(robot, [:base, :imu]) == nil
    end

    test "or is killed, no process and no alarm are left" do
      robot = one_of_three()
      imu(robot, init: fn _ -> {:stop, :absent} end)
      {:ok, root} = start_unlinked(robot)
      assert eventually(fn -> alarm(robot, [:base, :imu]) end)
      refs = monitor_all(robot)
      Process.exit(root, :kill)
      for ref <- refs, do: assert_receive({:DOWN, ^ref, _, _, _})
      assert eventually(fn -> alarm(robot, [:base, :imu]) == nil end)
    end

    test "a sensor that hangs is killed after five seconds" do
      robot = start_up(one_of_three())
      imu(robot, handle_cast: fn :hang, _ -> Process.sleep(:infinity) end)
      hanging = pid(robot, :imu)
      BB.cast(robot, :imu, :hang)
      ref = Process.monitor(hanging)
      BB.unsubscribe(robot, [:sensor_status])
      stop_supervised!(robot)
      assert_received {:DOWN, ^ref, _, _, :killed}
    end

    defp monitor_all(robot) do
      servers = for row <- BB.Sensor.health(robot), row.pid, do: row.pid
      for pid <- servers ++ Keyword.values(named(robot)), do: Process.monitor(pid)
    end

    defp named(robot), do: for({_id, pid} <- supervisors(robot), do: {:pid, pid})

    defp start_unlinked(robot) do
      test = self()

      spawn(fn ->
        Process.flag(:trap_exit, true)
        send(test, {:started, robot.start_link()})
        Process.sleep(:infinity)
      end)

      assert_receive {:started, started}
      started
    end
  end

  test "when the topology supervisor is killed, every sensor is up again, under its name and in health" do
    robot = start_up(one_of_three())
    before = for row <- BB.Sensor.health(robot), do: {row.name, row.pid}
    topology = BB.Process.whereis(robot, BB.TopologySupervisor)
    Process.exit(topology, :kill)

    for {name, old} <- before do
      assert eventually(fn ->
               row = health(robot, name)
               row.state == :up and row.pid != old and pid(robot, name) == row.pid
             end)
    end
  end

  describe "when the robot's registry or bus is killed," do
    test "every sensor is up again, under its name and in health, and so is its silence" do
      for part <- [Registry, Registry.PIDPartition0, PubSub] do
        robot =
          robot do
            sensors do
              sensor :first, BB.Test.Counter
              sensor :imu, BB.Test.Probe, max_silence: ~u(100 millisecond)
            end
          end

        root = start_supervised!(robot)
        assert eventually(fn -> health(robot, :imu).state == :stale end)
        victim = Process.whereis(Module.concat(robot, part))
        ref = Process.monitor(victim)
        Process.exit(victim, :kill)
        assert_receive {:DOWN, ^ref, _, _, _}

        assert eventually(fn ->
                 Process.whereis(Module.concat(robot, part)) not in [nil, victim]
               end)

        assert eventually(fn -> counted?(robot) end)
        assert eventually(fn -> named?(robot, :first) and named?(robot, :imu) end)
        assert eventually(fn -> spoken?(robot) end)
        assert eventually(fn -> health(robot, :imu).state == :stale end)
        assert Process.whereis(robot) == root
      end
    end

    # The bus may go down between any two lines here, so each is tried again.
    defp counted?(robot) do
      {:ok, _} = BB.subscribe(robot, [:sensor, :first])
      assert_receive {:bb, [:sensor, :first], %{robot: ^robot}}
      BB.unsubscribe(robot, [:sensor, :first])
    rescue
      _ in [ArgumentError, ExUnit.AssertionError] -> false
    end

    defp spoken?(robot) do
      BB.publish(robot, [:sensor, :imu], elem(Counter.Count.new(:imu, n: 1), 1))
      health(robot, :imu).state == :up
    end

    defp named?(robot, name) do
      pid = pid(robot, name)
      is_pid(pid) and health(robot, name).pid == pid
    rescue
      ArgumentError -> false
    end
  end
end
