defmodule BB.SupervisorTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
  import ExUnit.CaptureLog

  alias BB.Message.Sensor.Status
  alias BB.Options.ValidationError
  alias BB.Test.{Counter, Probe}

  # A robot with a scripted sensor :imu between two that count.
  defp one_of_three do
    robot do
      sensors do
        sensor :first, BB.Test.Counter
      end

      topology do
        link :base do
          sensor :imu, BB.Test.Probe
          sensor :second, BB.Test.Counter
        end
      end
    end
  end

  defp imu(robot, callbacks), do: Probe.script(robot, :imu, callbacks)
  defp pid(robot, name), do: BB.Process.whereis(robot, name)

  defp start_watched(robot) do
    start_supervised!(robot)
    {:ok, _} = BB.subscribe(robot, [:sensor_status])
    robot
  end

  defp start_up(robot, name \\ :imu) do
    start_watched(robot)
    assert eventually(fn -> health(robot, name).state == :up end)
    robot
  end

  defmacrop assert_status(robot, name, status) do
    quote do
      assert_receive {:bb, [:sensor_status | _],
                      %BB.Message{
                        robot: unquote({:^, [], [robot]}),
                        frame_id: unquote(name),
                        payload: %Status{} = unquote(status)
                      }},
                     10_000
    end
  end

  defp alarm(robot, path) do
    case List.keyfind(:alarm_handler.get_alarms(), {BB.Sensor, robot, path}, 0) do
      nil -> nil
      {_id, description} -> description
    end
  end

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
      base = [robot, :topology, {:link, :base}]

      assert Enum.sort(for {id, _pid} <- supervisors(robot), do: id) ==
               Enum.sort([
                 [robot],
                 [robot, :topology],
                 [robot, :topology, {:sensor, :battery}],
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

    test "shows each sensor under its keeper, as a supervisor's child" do
      robot = start_up(one_of_three())
      keeper = keeper(robot, :imu)
      imu = pid(robot, :imu)
      assert [{:imu, ^imu, :worker, _}] = Supervisor.which_children(keeper)
      assert %{active: 1, specs: 1, workers: 1} = Supervisor.count_children(keeper)
    end
  end

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

    test "of the robot itself fail its start too" do
      assert {:error, %ValidationError{} = error} = one_of_three().start_link(speed: 3)
      assert Exception.message(error) =~ "unknown options [:speed]"
    end
  end

  describe "a device that is absent at boot" do
    test "leaves the robot running, and is up when it appears" do
      robot = one_of_three()
      imu(robot, init: fn _ -> {:stop, {:no_answer, 0x68}} end)
      start_watched(robot)
      assert eventually(fn -> health(robot, :imu).state == :backoff end)
      assert %{reason: {:no_answer, 0x68}, pid: nil} = health(robot, :imu)
      assert eventually(fn -> health(robot, :second).state == :up end)
      assert pid(robot, :imu) == :undefined

      imu(robot, init: fn _ -> {:ok, nil} end)
      assert_status(robot, :imu, %{state: :up, reason: nil, retry_in_ms: nil, restarts: restarts})
      assert %{state: :up, restarts: ^restarts, reason: nil, pid: pid} = health(robot, :imu)
      assert restarts > 0
      assert pid(robot, :imu) == pid
    end

    test "is asked again as often as it takes" do
      robot = one_of_three()
      tries = :counters.new(1, [])

      imu(robot,
        init: fn _ ->
          :counters.add(tries, 1, 1)
          if :counters.get(tries, 1) <= 5, do: {:stop, :absent}, else: {:ok, nil}
        end
      )

      start_watched(robot)
      assert_status(robot, :imu, %{state: :up, restarts: 5})
      assert :counters.get(tries, 1) == 6
    end

    test "may also say {:error, reason}" do
      robot = one_of_three()
      imu(robot, init: fn _ -> {:error, :enodev} end)
      start_supervised!(robot)

      assert eventually(fn -> match?(%{state: :backoff, reason: :enodev}, health(robot, :imu)) end)
    end

    test "is no crash: the log has one warning with the reason, and one line when it is up" do
      robot = one_of_three()
      tries = :counters.new(1, [])

      imu(robot,
        init: fn _ ->
          :counters.add(tries, 1, 1)
          if :counters.get(tries, 1) <= 3, do: {:stop, "no answer at 0x68"}, else: {:ok, nil}
        end
      )

      log =
        capture_log(fn ->
          start_watched(robot)
          assert_status(robot, :imu, %{state: :up})
        end)

      ours = log |> String.split("\n") |> Enum.filter(&(&1 =~ "#{inspect(robot)}: "))
      assert [warning, info] = ours
      assert warning =~ "sensor :imu is down"
      assert warning =~ "no answer at 0x68"
      assert info =~ "sensor :imu is up again"
    end
  end

  describe "an init that hangs" do
    test "delays neither the robot's start nor another sensor, and is up when it returns" do
      robot = one_of_three()
      test = self()

      imu(robot,
        init: fn _ ->
          send(test, {:hanging, self()})
          receive do: (:go_on -> {:ok, nil})
        end
      )

      start_watched(robot)
      assert_receive {:hanging, hanging}, 5_000
      assert eventually(fn -> health(robot, :second).state == :up end)
      assert %{state: :starting, pid: ^hanging} = health(robot, :imu)
      send(hanging, :go_on)
      assert_status(robot, :imu, %{state: :up, restarts: 0})
    end

    test "does not hold up the robot's end" do
      robot = one_of_three()
      test = self()

      imu(robot,
        init: fn _ ->
          Process.flag(:trap_exit, true)
          send(test, {:hanging, self()})
          Process.sleep(:infinity)
        end
      )

      start_supervised!(robot)
      assert_receive {:hanging, hanging}, 5_000
      ref = Process.monitor(hanging)
      :ok = stop_supervised(robot)
      assert_received {:DOWN, ^ref, _, _, :killed}
    end

    test "is told after five seconds: stale, with an alarm" do
      robot = one_of_three()
      imu(robot, init: fn _ -> receive do: (:go_on -> {:ok, nil}) end)
      start_watched(robot)
      assert_status(robot, :imu, %{state: :stale, reason: {:init_timeout, 5_000}})
      assert alarm(robot, [:base, :imu])
      BB.send(robot, :imu, :go_on)
      assert_status(robot, :imu, %{state: :up})
      assert eventually(fn -> alarm(robot, [:base, :imu]) == nil end)
    end
  end

  describe "a sensor that goes down" do
    for how <- [
          "raises",
          "throws",
          "exits",
          "exits with :normal",
          "exits with :shutdown",
          "exits with {:shutdown, reason}",
          "is killed",
          "stops with a reason",
          "stops with :normal",
          "meets an error of the runtime",
          "is linked to what fails"
        ] do
      test "because it #{how} is up again, with the reason told" do
        {fun, reason} = ending(unquote(how))
        robot = start_up(one_of_three())
        before = pid(robot, :imu)
        imu(robot, handle_cast: fn :fail, state -> fun.(state) end)
        BB.cast(robot, :imu, :fail)
        assert_status(robot, :imu, %{state: :backoff, reason: ^reason, retry_in_ms: ms})
        assert ms in 50..100
        assert_status(robot, :imu, %{state: :up, reason: nil, retry_in_ms: nil, restarts: 1})
        assert pid(robot, :imu) != before
      end
    end

    defp ending("raises"), do: {fn _ -> raise "broken" end, %RuntimeError{message: "broken"}}
    defp ending("throws"), do: {fn _ -> throw(:ball) end, {:bad_return_value, :ball}}
    defp ending("exits"), do: {fn _ -> exit(:oops) end, :oops}
    defp ending("exits with :normal"), do: {fn _ -> exit(:normal) end, :normal}
    defp ending("exits with :shutdown"), do: {fn _ -> exit(:shutdown) end, :shutdown}
    defp ending("exits with {:shutdown" <> _), do: {fn _ -> exit({:shutdown, :wet}) end, :wet}
    defp ending("is killed"), do: {fn _ -> Process.exit(self(), :kill) end, :killed}
    defp ending("stops with a reason"), do: {fn s -> {:stop, {:i2c, :nak}, s} end, {:i2c, :nak}}
    defp ending("stops with :normal"), do: {fn s -> {:stop, :normal, s} end, :normal}

    defp ending("meets an error" <> _),
      do: {fn _ -> :erlang.binary_to_integer(inspect(self())) end, :badarg}

    defp ending("is linked" <> _) do
      {fn _ ->
         spawn_link(fn -> exit(:helper_failed) end)
         Process.sleep(:infinity)
       end, :helper_failed}
    end

    test "because its init crashes is up when init works again" do
      robot = one_of_three()
      imu(robot, init: fn _ -> raise "not yet" end)
      start_watched(robot)
      assert eventually(fn -> health(robot, :imu).state == :backoff end)
      assert %{reason: %RuntimeError{message: "not yet"}} = health(robot, :imu)
      imu(robot, init: fn _ -> {:ok, nil} end)
      assert_status(robot, :imu, %{state: :up})
    end

    test "has an alarm until it is up" do
      robot = start_up(one_of_three())
      assert alarm(robot, [:base, :imu]) == nil

      imu(robot, init: fn _ -> {:stop, :absent} end, handle_cast: fn _, s -> {:stop, :lost, s} end)

      BB.cast(robot, :imu, :fail)
      assert_status(robot, :imu, %{state: :backoff, reason: :lost})
      assert_status(robot, :imu, %{state: :backoff, reason: :absent})
      assert alarm(robot, [:base, :imu]) == %{state: :backoff, reason: :lost}
      imu(robot, init: fn _ -> {:ok, nil} end)
      assert_status(robot, :imu, %{state: :up})
      assert eventually(fn -> alarm(robot, [:base, :imu]) == nil end)
    end

    test "is told by telemetry" do
      robot = start_up(one_of_three())
      test = self()

      handler = fn _event, measurements, metadata, _config ->
        if metadata.robot == robot and metadata.path == [:base, :imu],
          do: send(test, {:telemetry, metadata.state, metadata.reason, measurements})
      end

      BB.Telemetry.attach({__MODULE__, robot}, [:bb, :sensor, :status], handler, nil)
      on_exit(fn -> BB.Telemetry.detach({__MODULE__, robot}) end)
      Process.exit(pid(robot, :imu), :kill)
      assert_receive {:telemetry, :backoff, :killed, %{restarts: 0}}, 5_000
      assert_receive {:telemetry, :up, nil, %{restarts: 1}}, 5_000
    end
  end

  describe "a fault of one sensor never reaches another:" do
    # Receives the counts of both counters until each has come on by `more`, and returns what they came to.
    defp count_on(robot, name, from, more) do
      Enum.each(from..(from + more - 1)//1, fn expected ->
        assert_receive {:bb, [:sensor | _], %{frame_id: ^name, payload: %Counter.Count{n: n}}},
                       5_000

        assert n == expected, "#{name} of #{inspect(robot)} came to #{n} after #{expected - 1}"
      end)

      from + more
    end

    defp first_count(name) do
      assert_receive {:bb, [:sensor | _], %{frame_id: ^name, payload: %Counter.Count{n: n}}},
                     5_000

      n + 1
    end

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
      assert eventually(fn -> Enum.all?(BB.Sensor.health(robot), &(&1.state == :up)) end)
      {:ok, _} = BB.subscribe(robot, [:sensor, :first])
      {:ok, _} = BB.subscribe(robot, [:sensor, :base, :second])
      supervisors = supervisors(robot)
      siblings = {pid(robot, :first), pid(robot, :second)}
      counts = {first_count(:first), first_count(:second)}

      {first, second} =
        Enum.reduce(1..5, counts, fn _round, {first, second} ->
          before = for name <- names, do: pid(robot, name)
          Enum.each(before, &Process.exit(&1, :kill))
          counts = {count_on(robot, :first, first, 50), count_on(robot, :second, second, 50)}

          assert eventually(fn ->
                   Enum.all?(Enum.zip(names, before), fn {name, old} ->
                     pid(robot, name) not in [old, :undefined]
                   end)
                 end)

          counts
        end)

      count_on(robot, :first, first, 10)
      count_on(robot, :second, second, 10)
      assert {pid(robot, :first), pid(robot, :second)} == siblings
      assert supervisors(robot) == supervisors
      assert eventually(fn -> Enum.all?(BB.Sensor.health(robot), &(&1.state == :up)) end)

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
      count_on(robot, :first, from, 100)
      assert supervisors(robot) == supervisors
    end
  end

  describe "a keeper that is killed" do
    test "is started again; the old server is gone, and there is only one" do
      robot = start_up(one_of_three())
      old = pid(robot, :imu)
      siblings = {pid(robot, :first), pid(robot, :second)}
      keeper = keeper(robot, :imu)
      refs = for pid <- [old, keeper], do: Process.monitor(pid)
      Process.exit(keeper, :kill)
      for ref <- refs, do: assert_receive({:DOWN, ^ref, _, _, :killed}, 5_000)
      assert_status(robot, :imu, %{state: :up, restarts: 1})
      new = pid(robot, :imu)
      assert new != old
      assert [{:imu, ^new, _, _}] = Supervisor.which_children(keeper(robot, :imu))
      assert {pid(robot, :first), pid(robot, :second)} == siblings
    end

    test "leaves no server behind that hangs and traps exits" do
      robot = one_of_three()
      test = self()

      imu(robot,
        init: fn _ ->
          Process.flag(:trap_exit, true)
          {:ok, nil}
        end,
        handle_cast: fn :hang, _ ->
          send(test, :hangs)
          Process.sleep(:infinity)
        end
      )

      start_up(robot)
      old = pid(robot, :imu)
      BB.cast(robot, :imu, :hang)
      assert_receive :hangs, 5_000
      ref = Process.monitor(old)
      Process.exit(keeper(robot, :imu), :kill)
      assert_receive {:DOWN, ^ref, _, _, :killed}, 5_000
      assert_status(robot, :imu, %{state: :up, restarts: 1})
      refute pid(robot, :imu) == old
    end

    test "leaves no alarm behind" do
      robot = one_of_three()
      imu(robot, init: fn _ -> {:stop, :absent} end)
      start_watched(robot)
      assert eventually(fn -> alarm(robot, [:base, :imu]) end)
      imu(robot, init: fn _ -> {:ok, nil} end)
      Process.exit(keeper(robot, :imu), :kill)
      assert_status(robot, :imu, %{state: :up})
      assert eventually(fn -> alarm(robot, [:base, :imu]) == nil end)
    end
  end

  describe "max_silence" do
    defp silent_robot do
      robot do
        topology do
          link :base do
            sensor :imu, BB.Test.Probe, max_silence: ~u(100 millisecond)
            sensor :second, BB.Test.Counter
          end
        end
      end
    end

    defp speaking(robot) do
      imu(robot,
        handle_cast: fn :speak, bb ->
          {:ok, message} = Counter.Count.new(:imu, n: 0)
          BB.Sensor.publish(bb, message)
          {:noreply, bb}
        end
      )

      robot
    end

    test "passed makes a sensor stale, with an alarm, until its next message" do
      robot = speaking(silent_robot())
      start_watched(robot)
      assert_status(robot, :imu, %{state: :stale, reason: {:silent, 100}, retry_in_ms: nil})
      before = pid(robot, :imu)
      assert alarm(robot, [:base, :imu]) == %{state: :stale, reason: {:silent, 100}}
      assert %{state: :stale, pid: ^before} = health(robot, :imu)
      BB.cast(robot, :imu, :speak)
      assert_status(robot, :imu, %{state: :up, reason: nil, restarts: 0})
      assert_status(robot, :imu, %{state: :stale})
      assert pid(robot, :imu) == before
    end

    test "is not passed by a sensor that publishes" do
      robot =
        robot do
          sensors do
            sensor :first, BB.Test.Counter, max_silence: ~u(1 second)
          end
        end

      start_up(robot, :first)
      {:ok, _} = BB.subscribe(robot, [:sensor, :first])
      count_on(robot, :first, first_count(:first), 600)
      assert %{state: :up} = health(robot, :first)
      refute_received {:bb, [:sensor_status | _], %{payload: %{state: :stale}}}
    end

    test "is none of another sensor's" do
      robot = silent_robot()
      start_watched(robot)
      assert_status(robot, :imu, %{state: :stale})
      assert %{state: :up} = health(robot, :second)
    end

    test "counts from when the sensor is up again" do
      robot = speaking(silent_robot())
      start_watched(robot)
      assert_status(robot, :imu, %{state: :stale})
      Process.exit(pid(robot, :imu), :kill)
      assert_status(robot, :imu, %{state: :backoff, reason: :killed})
      assert_status(robot, :imu, %{state: :up})
      assert_status(robot, :imu, %{state: :stale})
    end
  end

  describe "health" do
    test "lists all sensors in the order of their declaration" do
      robot = start_up(one_of_three())
      assert [first, imu, second] = BB.Sensor.health(robot)
      assert {first.name, imu.name, second.name} == {:first, :imu, :second}

      assert %{
               path: [:base, :imu],
               module: Probe,
               required: false,
               state: :up,
               restarts: 0,
               reason: nil,
               retry_in_ms: nil,
               since: since
             } = imu

      assert imu.pid == pid(robot, :imu)
      assert since <= System.monotonic_time(:nanosecond)
    end

    test "of a robot that is not started raises" do
      robot = one_of_three()
      assert_raise ArgumentError, ~r/not started/, fn -> BB.Sensor.health(robot) end
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
      assert eventually(fn -> Enum.all?(BB.Sensor.health(robot), &(&1.state == :up)) end)
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
      for ref <- refs, do: assert_receive({:DOWN, ^ref, _, _, _}, 5_000)
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

      assert_receive {:started, started}, 5_000
      started
    end
  end

  describe "when the robot's registry or bus is killed," do
    test "every sensor is up again, under its name and in health, and so is its silence" do
      for part <- [Registry, Registry.PIDPartition0, PubSub, PubSub.PIDPartition0] do
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
        assert_receive {:DOWN, ^ref, _, _, _}, 5_000

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
      assert_receive {:bb, [:sensor, :first], %{robot: ^robot}}, 100
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
