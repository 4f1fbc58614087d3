defmodule BB.Component.KeeperTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
  import BB.Test.Watch
  import ExUnit.CaptureLog

  alias BB.Test.Counter

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

    test "is retried until it answers" do
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

    test "may also return {:error, reason}" do
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
      assert_receive {:hanging, hanging}
      assert eventually(fn -> health(robot, :second).state == :up end)
      assert %{state: :starting, pid: ^hanging} = health(robot, :imu)
      send(hanging, :go_on)
      assert_status(robot, :imu, %{state: :up, restarts: 0})
    end

    test "does not delay the robot's end" do
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
      assert_receive {:hanging, hanging}
      ref = Process.monitor(hanging)
      :ok = stop_supervised(robot)
      assert_received {:DOWN, ^ref, _, _, :killed}
    end

    test "makes the sensor stale after five seconds, with an alarm" do
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
      test "because it #{how} is up again, and its status has the reason" do
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

    test "emits a telemetry event" do
      robot = start_up(one_of_three())
      test = self()

      handler = fn _event, measurements, metadata, _config ->
        if metadata.robot == robot and metadata.path == [:base, :imu],
          do: send(test, {:telemetry, metadata.state, metadata.reason, measurements})
      end

      BB.Telemetry.attach({__MODULE__, robot}, [:bb, :sensor, :status], handler, nil)
      on_exit(fn -> BB.Telemetry.detach({__MODULE__, robot}) end)
      Process.exit(pid(robot, :imu), :kill)
      assert_receive {:telemetry, :backoff, :killed, %{restarts: 0}}
      assert_receive {:telemetry, :up, nil, %{restarts: 1}}
    end
  end

  describe "a sensor that sets the limit of its terminate/2" do
    test "has that time: the robot's end waits" do
      robot = one_of_three()
      test = self()

      imu(robot,
        init: fn opts -> BB.Sensor.shut_down_within(60_000) && {:ok, opts[:bb]} end,
        terminate: fn _reason, _bb ->
          Process.sleep(5_500)
          send(test, :stopped)
        end
      )

      start_up(robot)
      stop_supervised!(robot)
      assert_received :stopped
    end

    test "has no more than that" do
      robot = one_of_three()

      imu(robot,
        init: fn opts -> BB.Sensor.shut_down_within(50) && {:ok, opts[:bb]} end,
        terminate: fn _reason, _bb -> Process.sleep(:infinity) end
      )

      start_up(robot)
      ref = Process.monitor(pid(robot, :imu))
      stop_supervised!(robot)
      assert_received {:DOWN, ^ref, _, _, :killed}
    end

    test "has it too when it has just come up" do
      robot = one_of_three()
      test = self()

      imu(robot,
        init: fn opts ->
          send(test, {:in_init, self()})
          receive do: (:go_on -> {:ok, opts[:bb]})
        end,
        terminate: fn _reason, _bb -> send(test, :stopped) end
      )

      start_supervised!(robot)
      assert_receive {:in_init, sensor}
      keeper = keeper(robot, :imu)
      :ok = :sys.suspend(keeper)
      send(sensor, :go_on)
      eventually(fn -> match?({_, [_ | _]}, Process.info(keeper, :messages)) end)
      stop_supervised!(robot)
      assert_received :stopped
    end
  end

  describe "a keeper that is killed" do
    test "is restarted; the old server has exited, and one server runs" do
      robot = start_up(one_of_three())
      old = pid(robot, :imu)
      siblings = {pid(robot, :first), pid(robot, :second)}
      keeper = keeper(robot, :imu)
      refs = for pid <- [old, keeper], do: Process.monitor(pid)
      Process.exit(keeper, :kill)
      for ref <- refs, do: assert_receive({:DOWN, ^ref, _, _, :killed})
      assert_status(robot, :imu, %{state: :up, restarts: 1})
      new = pid(robot, :imu)
      assert new != old
      assert [{:imu, ^new, _, _}] = Supervisor.which_children(keeper(robot, :imu))
      assert {pid(robot, :first), pid(robot, :second)} == siblings
    end

    test "leaves no server that hangs and traps exits" do
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
      assert_receive :hangs
      ref = Process.monitor(old)
      Process.exit(keeper(robot, :imu), :kill)
      assert_receive {:DOWN, ^ref, _, _, :killed}
      assert_status(robot, :imu, %{state: :up, restarts: 1})
      refute pid(robot, :imu) == old
    end

    test "leaves no alarm" do
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

    test "that has passed makes a sensor stale, with an alarm, until its next message" do
      robot = speaking(silent_robot())
      start_watched(robot, replay: true)
      assert_status(robot, :imu, %{state: :stale, reason: {:silent, 100}, retry_in_ms: nil})
      before = pid(robot, :imu)
      assert alarm(robot, [:base, :imu]) == %{state: :stale, reason: {:silent, 100}}
      assert %{state: :stale, pid: ^before} = health(robot, :imu)
      BB.cast(robot, :imu, :speak)
      assert_status(robot, :imu, %{state: :up, reason: nil, restarts: 0})
      assert_status(robot, :imu, %{state: :stale})
      assert pid(robot, :imu) == before
    end

    test "does not pass while a sensor publishes" do
      robot =
        robot do
          sensors do
            sensor :first, BB.Test.Counter, max_silence: ~u(1 second)
          end
        end

      start_up(robot, :first)
      {:ok, _} = BB.subscribe(robot, [:sensor, :first])
      count_on(:first, first_count(:first), 600)
      assert %{state: :up} = health(robot, :first)
      refute_received {:bb, [:sensor_status | _], %{payload: %{state: :stale}}}
    end

    test "sends the keeper none of the messages" do
      robot =
        robot do
          sensors do
            sensor :first, BB.Test.Counter, max_silence: ~u(10 second)
          end
        end

      start_up(robot, :first)
      {:ok, _} = BB.subscribe(robot, [:sensor, :first])
      keeper = keeper(robot, :first)
      :erlang.trace(keeper, true, [:receive])
      count_on(:first, first_count(:first), 200)
      :erlang.trace(keeper, false, [:receive])
      refute_received {:trace, ^keeper, :receive, _message}
      assert [{test, []}] = BB.PubSub.subscribers(robot, [:sensor, :first])
      assert test == self()
    end

    test "does not pass while a sensor publishes messages with arbitrary times" do
      for shift_ns <- [-60_000_000_000, 60_000_000_000] do
        robot =
          robot do
            sensors do
              sensor :imu, BB.Test.Probe, max_silence: ~u(2 second)
            end
          end

        imu(robot,
          init: fn opts ->
            send(self(), :speak)
            {:ok, opts[:bb]}
          end,
          handle_info: fn :speak, bb ->
            time = [monotonic_time: System.monotonic_time(:nanosecond) + shift_ns]
            BB.Sensor.publish(bb, BB.Message.new!(Counter.Count, :imu, [n: 0], time))
            Process.send_after(self(), :speak, 20)
            {:noreply, bb}
          end
        )

        start_up(robot)
        {:ok, _} = BB.subscribe(robot, [:sensor, :imu])
        # Several times its max_silence.
        for _ <- 1..250, do: assert_receive({:bb, [:sensor, :imu], _message})
        assert %{state: :up} = health(robot, :imu)
        refute_received {:bb, [:sensor_status | _], %{payload: %{state: :stale}}}
      end
    end

    test "counts the heartbeats of a sensor that publishes elsewhere" do
      robot = silent_robot()

      imu(robot,
        handle_cast: fn :carry, bb ->
          BB.Sensor.beat()
          {:noreply, bb}
        end
      )

      start_watched(robot, replay: true)
      assert_status(robot, :imu, %{state: :stale})
      BB.cast(robot, :imu, :carry)
      assert_status(robot, :imu, %{state: :up, restarts: 0})
      assert_status(robot, :imu, %{state: :stale})
    end

    test "does not pass unnoticed: a message found late makes it up, then stale" do
      robot = speaking(silent_robot())
      start_supervised!(robot)
      eventually(fn -> health(robot, :imu).state == :stale end)
      keeper = keeper(robot, :imu)
      :ok = :sys.suspend(keeper)
      for path <- [[:sensor], [:sensor_status]], do: {:ok, _} = BB.subscribe(robot, path)
      BB.cast(robot, :imu, :speak)
      assert_receive {:bb, [:sensor, :base, :imu], %{monotonic_time: spoken_ns}}
      late? = fn -> System.monotonic_time(:nanosecond) - spoken_ns > 200_000_000 end
      eventually(late?)
      :ok = :sys.resume(keeper)
      assert_status(robot, :imu, %{state: :up, restarts: 0})
      assert_status(robot, :imu, %{state: :stale})
    end

    test "is readable by the sensor itself" do
      robot = silent_robot()
      imu(robot, handle_call: fn :ask, _, bb -> {:reply, BB.Sensor.max_silence_ns(), bb} end)
      start_up(robot)
      assert BB.call(robot, :imu, :ask) == 100_000_000
    end

    test "of one sensor does not apply to another" do
      robot = silent_robot()
      start_watched(robot, replay: true)
      assert_status(robot, :imu, %{state: :stale})
      assert %{state: :up} = health(robot, :second)
    end

    test "counts from when the sensor is up again" do
      robot = speaking(silent_robot())
      start_watched(robot, replay: true)
      assert_status(robot, :imu, %{state: :stale})
      Process.exit(pid(robot, :imu), :kill)
      assert_status(robot, :imu, %{state: :backoff, reason: :killed})
      assert_status(robot, :imu, %{state: :up})
      assert_status(robot, :imu, %{state: :stale})
    end
  end

  describe "a registry of the robot that is about to restart" do
    test "lets no component with a keeper start without its name" do
      args = [
        __callback_module__: BB.Test.Probe,
        __kind__: BB.Sensor,
        bb: %{robot: RobotWithoutRegistry, path: [:imu]}
      ]

      assert_raise ArgumentError, fn ->
        BB.Component.Server.start_link([__keeper__: self()] ++ args)
      end
    end
  end
end
