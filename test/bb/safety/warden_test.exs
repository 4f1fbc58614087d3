defmodule BB.Safety.WardenTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Safety
  alias BB.Test.{Brake, Probe}

  @a [:base, :a]
  @b [:base, :joint, :b]

  defp with_brakes do
    robot do
      topology do
        link :base do
          sensor :a, BB.Test.Brake
          sensor :plain, BB.Test.Probe

          joint :joint do
            type :fixed
            actuator :b, BB.Test.Caliper
            link :tip
          end
        end
      end
    end
  end

  # Started by a process that does not mind how it ends. What a killed root has left behind may still have its names.
  defp start(robot \\ with_brakes()) do
    test = self()

    spawn(fn ->
      Process.flag(:trap_exit, true)
      send(test, {:started, eventually(fn -> started(robot.start_link()) end)})
      Process.sleep(:infinity)
    end)

    assert_receive {:started, root}
    on_exit(fn -> stop(root) end)
    assert await_all_up(robot)
    {robot, root}
  end

  defp started({:ok, root}), do: root
  defp started(_error), do: nil

  defp stop(root) do
    Supervisor.stop(root)
  catch
    :exit, _ -> :ok
  end

  describe "an armed robot whose topology supervisor dies" do
    for reason <- [:kill, :broken, :shutdown] do
      test "by #{inspect(reason)} is in error: every registered disarm ran exactly once" do
        {robot, root} = start()
        {:ok, _} = BB.subscribe(robot, [:state_machine])
        :ok = Safety.arm(robot)
        end_process(topology(root), unquote(reason))
        assert_receive {:bb, [:state_machine], %{payload: %{from: :armed, to: :disarming}}}
        assert_receive {:bb, [:state_machine], %{payload: %{from: :disarming, to: :error}}}
        assert Safety.in_error?(robot)
        assert_up_again(robot)
        assert runs(robot) == {1, 1}
        assert Process.whereis(robot) == root
      end
    end

    test "can be armed again after an acknowledgement, and disarmed again" do
      {robot, root} = start()
      :ok = Safety.arm(robot)
      end_process(topology(root), :kill)
      assert eventually(fn -> Safety.in_error?(robot) end)
      assert Safety.arm(robot) == {:error, :in_error}
      assert Safety.disarm(robot) == {:error, :already_in_error}
      assert Safety.force_disarm(robot) == :ok
      assert Safety.arm(robot) == :ok
      assert_up_again(robot)
      :ok = Safety.disarm(robot)
      assert runs(robot) == {2, 2}
    end
  end

  describe "the topology supervisor's death is an error" do
    test "also when the root gives up after it, and until the robot that has ended is acknowledged" do
      {robot, root} = start()
      ref = Process.monitor(root)
      :ok = Safety.arm(robot)
      end_topologies(root, ref)
      assert Safety.state(robot) == :error
      assert runs(robot) == {1, 1}
      assert Safety.force_disarm(robot) == :ok
      assert_forgotten(robot)
    end

    test "but not when the root was killed, or the robot stopped" do
      for blow <- [:root, :stop] do
        {robot, root} = start()
        :ok = Safety.arm(robot)
        strike(blow, root)
        assert eventually(fn -> not Safety.Records.known?(robot) end)
        assert runs(robot) == {1, 1}
      end
    end

    test "but nothing for a robot that is disarmed" do
      {robot, root} = start()
      end_process(topology(root), :kill)
      assert_up_again(robot)
      assert Safety.arm(robot) == :ok
    end

    test "also when a robot was stopped, and started again" do
      {robot, root} = start()
      Supervisor.stop(root)
      assert_forgotten(robot)
      {^robot, root} = start(robot)
      :ok = Safety.arm(robot)
      end_process(topology(root), :kill)
      assert eventually(fn -> Safety.in_error?(robot) end)
    end

    test "also when the notice of a stop was killed before" do
      {robot, root} = start()
      {_id, notice, _, _} = List.keyfind(Supervisor.which_children(root), Safety.StopNotice, 0)
      end_process(notice, :kill)
      :ok = Safety.arm(robot)
      end_process(topology(root), :kill)
      assert eventually(fn -> Safety.in_error?(robot) end)
    end

    defp end_topologies(root, ref) do
      case root |> topologies() |> Enum.find(&is_pid/1) do
        nil -> :ok
        topology -> Process.exit(topology, :kill)
      end

      receive do
        {:DOWN, ^ref, :process, ^root, _reason} -> :ok
      after
        10 -> end_topologies(root, ref)
      end
    end

    defp topologies(root) do
      for {BB.TopologySupervisor, pid, _, _} <- Supervisor.which_children(root), do: pid
    catch
      :exit, _ended -> []
    end
  end

  describe "a robot that is made safe" do
    test "is disarmed if it was armed before" do
      {robot, _root} = start()
      :ok = Safety.arm(robot)
      assert Safety.Wardens.secure(robot, Safety.Warden.moment()) == :ok
      assert Safety.state(robot) == :disarmed
      assert runs(robot) == {1, 1}
    end

    # The application has ended and was started again, before what its end sets off had its turn.
    test "stays armed if it was armed since" do
      {robot, _root} = start()
      ended = Safety.Warden.moment()
      :ok = Safety.arm(robot)
      assert Safety.Wardens.secure(robot, ended) == :ok
      assert Safety.armed?(robot)
      assert runs(robot) == {0, 0}
    end
  end

  describe "an armed robot whose root dies" do
    for reason <- [:kill, :broken] do
      test "by #{inspect(reason)} is disarmed: every registered disarm ran exactly once" do
        {robot, root} = start()
        :ok = Safety.arm(robot)
        end_process(root, unquote(reason))
        assert eventually(fn -> runs(robot) == {1, 1} end)
        assert_forgotten(robot)
        assert runs(robot) == {1, 1}
      end
    end

    test "and that is started anew at once is disarmed, and each disarm ran exactly once" do
      {robot, root} = start()
      :ok = Safety.arm(robot)
      end_process(root, :kill)
      {^robot, _root} = start(robot)
      assert_disarmed_state(robot)
      assert_up_again(robot)
      assert runs(robot) == {1, 1}
    end
  end

  test "an armed robot that is stopped is disarmed when the stop returns, after its components have ended" do
    {robot, root} = start()
    test = self()
    {:ok, _} = BB.subscribe(robot, [:state_machine])

    tell = fn opts ->
      send(test, {:disarm, opts[:bb].path, Process.whereis(BB.Process.registry_name(robot))})
      :ok
    end

    Brake.script(robot, @a, disarm: tell)
    Probe.script(robot, :plain, terminate: fn _, _ -> send(test, :terminated) end)
    :ok = Safety.arm(robot)
    Supervisor.stop(root)
    assert runs(robot) == {1, 1}
    assert {:messages, messages} = Process.info(self(), :messages)
    ended = Enum.find_index(messages, &(&1 == :terminated))
    disarmed = Enum.find_index(messages, &match?({:disarm, @a, _}, &1))
    assert ended < disarmed
    # The bus ends last, so that it can tell.
    assert_received {:bb, _, %{payload: %{from: :disarming, to: :disarmed}}}
    assert_forgotten(robot)
  end

  test "the stop of an armed robot returns after the slowest handler" do
    {robot, root} = start()
    {_id, latch, _, _} = root |> Supervisor.which_children() |> List.keyfind(BB.Safety.Latch, 0)
    done = :counters.new(1, [])

    # It goes on when the stop waits for it, or does not wait any more.
    Brake.script(robot, @a,
      disarm: fn _opts ->
        eventually(fn -> waits?(latch) or not Process.alive?(root) end, 30_000)
        :counters.add(done, 1, if(Process.alive?(root), do: 1, else: 0))
      end
    )

    :ok = Safety.arm(robot)
    Supervisor.stop(root)
    assert :counters.get(done, 1) == 1
    assert runs(robot) == {1, 1}
  end

  defp waits?(pid) do
    case Process.info(pid, :current_stacktrace) do
      {:current_stacktrace, frames} -> Enum.any?(frames, &(elem(&1, 0) == BB.Safety.Wardens))
      nil -> false
    end
  end

  for blow <- [:topology, :root, :stop] do
    @blow blow

    test "a robot whose actuator is in the middle of a restart: every registered disarm ran exactly once (#{blow})" do
      {robot, root} = start()
      :ok = Safety.arm(robot)
      test = self()

      Brake.script(robot, @b,
        init: fn _opts ->
          send(test, {:restarting, robot})
          Process.sleep(:infinity)
        end
      )

      BB.cast(robot, :b, :crash)
      assert_receive {:restarting, ^robot}
      strike(@blow, root)
      assert eventually(fn -> Safety.state(robot) == state_after(@blow) end)
      assert runs(robot) == {1, 1}
      assert_settled(@blow, robot)
      assert runs(robot) == {1, 1}
    end

    test "a robot whose actuator is down: every registered disarm ran exactly once (#{blow})" do
      {robot, root} = start()
      :ok = Safety.arm(robot)
      Brake.script(robot, @b, init: fn _opts -> {:stop, :absent} end)
      BB.cast(robot, :b, :crash)
      assert eventually(fn -> match?([%{state: :backoff}], BB.Actuator.health(robot)) end)
      strike(@blow, root)
      assert eventually(fn -> Safety.state(robot) == state_after(@blow) end)
      assert runs(robot) == {1, 1}
      assert_settled(@blow, robot)
      assert runs(robot) == {1, 1}
    end
  end

  defp state_after(:topology), do: :error
  defp state_after(_blow), do: :disarmed

  # All that a blow leads to is over: a robot is up again, or gone.
  defp assert_settled(:topology, robot) do
    Brake.script(robot, @b, init: fn opts -> {:ok, opts} end)
    _hangs = BB.Process.whereis(robot, :b) |> kill()
    assert_up_again(robot)
  end

  defp assert_settled(_blow, robot), do: assert_forgotten(robot)

  defp kill(:undefined), do: false
  defp kill(pid), do: Process.exit(pid, :kill)

  test "a robot that is disarmed when its tree dies has nothing to be made safe: no disarm runs" do
    {robot, root} = start()
    end_process(topology(root), :kill)
    assert eventually(fn -> topology(root) != :restarting end)
    assert_up_again(robot)
    end_process(root, :kill)
    assert_forgotten(robot)
    assert runs(robot) == {0, 0}
  end

  test "a disarming under way when the tree dies runs each disarm once" do
    {robot, root} = start()
    {held, disarming} = hold_disarming(robot)
    end_process(topology(root), :kill)
    end_process(root, :kill)
    send(held, :go_on)
    assert Task.await(disarming, :infinity) == :ok
    assert_forgotten(robot)
    assert runs(robot) == {1, 1}
  end

  test "a robot that is started anew while its predecessor's disarm is under way is not armed until that is done" do
    {robot, root} = start()
    {held, disarming} = hold_disarming(robot)
    end_process(root, :kill)
    {^robot, _root} = start(robot)
    assert Safety.state(robot) == :disarming
    assert Safety.arm(robot) == {:error, :disarming}
    send(held, :go_on)
    assert Task.await(disarming, :infinity) == :ok
    assert Safety.arm(robot) == :ok
    Brake.script(robot, @a, disarm: fn _opts -> :ok end)
    assert_up_again(robot)
    assert Safety.disarm(robot) == :ok
    assert runs(robot) == {2, 2}
  end

  describe "who is outside of the robot's tree" do
    for {how, blow} <- [
          "was stopped and started": :stop,
          "was killed and started": :root,
          "has a topology that was killed": :topology
        ] do
      test "and vouched before the robot was started is watched, also when it #{how}" do
        robot = with_brakes()
        voucher = act_apart(fn -> Safety.vouch(robot, [:lid]) end)
        {^robot, root} = start(robot)
        strike(unquote(blow), root)
        if unquote(blow) != :topology, do: start(robot)
        assert eventually(fn -> Safety.arm(robot) == :ok end, 30_000)
        end_process(voucher, :kill)
        assert eventually(fn -> Safety.state(robot) == :disarmed end, 30_000)
        assert Safety.inhibitions(robot) == [{[:lid], :unattended}]
      end

      test "and registered a handler finds it called once, also when the robot #{how}" do
        robot = with_brakes()
        Brake.register_apart(robot, [:before])
        {^robot, root} = start(robot)
        Brake.register_apart(robot, [:while])
        strike(unquote(blow), root)
        if unquote(blow) != :topology, do: start(robot)
        assert eventually(fn -> Safety.arm(robot) == :ok end, 30_000)
        assert Safety.disarm(robot) == :ok
        assert {Brake.runs(robot, [:before]), Brake.runs(robot, [:while])} == {1, 1}
      end
    end

    test "and vouches while the warden ends is known by its successor" do
      robot = with_brakes()

      # Each makes the robot known and ends, which lets its warden end, while the next one comes.
      vouchers = for n <- 1..50, do: act_apart(fn -> Safety.vouch(robot, [:"lid_#{n}"]) end)
      for voucher <- vouchers, do: spawn(fn -> Process.exit(voucher, :kill) end)
      last = act_apart(fn -> Safety.vouch(robot, [:last]) end)
      for n <- 1..50, do: Safety.allow(robot, [:"lid_#{n}"])
      start(robot)
      assert eventually(fn -> Safety.arm(robot) == :ok end, 30_000)
      end_process(last, :kill)
      assert eventually(fn -> Safety.state(robot) == :disarmed end, 30_000)
    end

    test "and ends while the robot is not started has no handler any more" do
      robot = with_brakes()
      owner = Brake.register_apart(robot, [:outside])
      {^robot, root} = start(robot)
      Supervisor.stop(root)
      assert_forgotten(robot)
      end_process(owner, :kill)
      start(robot)
      assert eventually(fn -> Safety.arm(robot) == :ok end, 30_000)
      :ok = Safety.disarm(robot)
      assert Brake.runs(robot, [:outside]) == 0
      assert runs(robot) == {1, 1}
    end

    test "and vouches is watched although somebody forbade arming and the warden was killed" do
      {robot, _root} = start()
      voucher = act_apart(fn -> Safety.vouch(robot, [:lid]) end)
      :ok = Safety.arm(robot)
      :ok = Safety.inhibit(robot, [:lid], :open)
      kill_warden(robot)
      end_process(voucher, :kill)
      assert eventually(fn -> Safety.state(robot) == :disarmed end, 30_000)
      assert Safety.inhibitions(robot) == [{[:lid], :open}]
    end

    test "and has died while there was no warden is missed by its successor" do
      {robot, _root} = start()
      voucher = act_apart(fn -> Safety.vouch(robot, [:lid]) end)
      :ok = Safety.arm(robot)
      :sys.suspend(warden(robot))
      end_process(voucher, :kill)
      kill_warden(robot)
      assert eventually(fn -> Safety.state(robot) == :disarmed end, 30_000)
      assert runs(robot) == {1, 1}
    end

    # By a process that stays.
    defp act_apart(fun) do
      test = self()

      pid =
        spawn(fn ->
          send(test, {self(), fun.()})
          Process.sleep(:infinity)
        end)

      assert_receive {^pid, :ok}, 30_000
      pid
    end
  end

  test "an error outlives the robot: who starts it anew has to look at the hardware" do
    {robot, root} = start()
    Brake.script(robot, @a, disarm: fn _opts -> {:error, :stuck} end)
    :ok = Safety.arm(robot)
    end_process(root, :kill)
    assert eventually(fn -> Safety.state(robot) == :error end)
    {^robot, _root} = start(robot)
    assert Safety.arm(robot) == {:error, :in_error}
    assert Safety.force_disarm(robot) == :ok
    assert Safety.arm(robot) == :ok
  end

  test "an error of a robot that is not started any more can be acknowledged" do
    {robot, root} = start()
    Brake.script(robot, @a, disarm: fn _opts -> {:error, :stuck} end)
    :ok = Safety.arm(robot)
    end_process(root, :kill)
    assert eventually(fn -> Safety.state(robot) == :error end)
    assert Safety.force_disarm(robot) == :ok
    assert_forgotten(robot)
  end

  test "one robot's slow handler never delays another robot" do
    {slow, _} = start()
    {quick, _} = start()
    {held, disarming} = hold_disarming(slow)
    :ok = Safety.arm(quick)
    assert Safety.disarm(quick) == :ok
    assert Safety.state(slow) == :disarming
    send(held, :go_on)
    assert Task.await(disarming, :infinity) == :ok
  end

  test "handlers of telemetry that hang at the arming hold up no disarming" do
    {robot, _root} = start()
    test = self()

    hang = fn _event, _measurements, metadata, n ->
      if metadata.robot == robot do
        send(test, {:hangs, n})
        Process.sleep(:infinity)
      end
    end

    # Each may take a second. The last one is still to come when the first one hangs.
    for n <- 1..10 do
      :ok = BB.Telemetry.attach({robot, n}, [:bb, :safety, :transition], hang, n)
      on_exit(fn -> BB.Telemetry.detach({robot, n}) end)
    end

    arming = Task.async(fn -> Safety.arm(robot) end)
    assert_receive {:hangs, first}, 30_000
    assert Safety.disarm(robot) == :ok
    assert runs(robot) == {1, 1}
    last = 11 - first
    refute_received {:hangs, ^last}
    assert Task.await(arming, 60_000) == :ok
  end

  describe "the state survives a crash of the safety process:" do
    test "armed stays armed, with handlers, epoch and what inhibits arming" do
      {robot, _root} = start()
      :ok = Safety.arm(robot)
      epoch = Safety.epoch(robot)
      :ok = Safety.inhibit(robot, [:lid], :open)
      kill_warden(robot)
      assert Safety.armed?(robot)
      assert Safety.arm(robot) == {:error, :already_armed}
      assert Safety.epoch(robot) == epoch
      assert Safety.disarm(robot) == :ok
      assert runs(robot) == {1, 1}
      assert Safety.arm(robot) == {:error, {:inhibited, [{[:lid], :open}]}}
    end

    test "its successor sees the topology die" do
      {robot, root} = start()
      :ok = Safety.arm(robot)
      kill_warden(robot)
      end_process(topology(root), :kill)
      assert eventually(fn -> Safety.in_error?(robot) end)
      assert_up_again(robot)
      assert runs(robot) == {1, 1}
    end

    test "its successor sees the root die" do
      {robot, root} = start()
      :ok = Safety.arm(robot)
      kill_warden(robot)
      end_process(root, :kill)
      assert eventually(fn -> runs(robot) == {1, 1} end)
      assert_forgotten(robot)
    end

    test "a disarming goes on, runs each disarm once, and whoever asked for it gets the answer" do
      {robot, _root} = start()
      {held, disarming} = hold_disarming(robot)

      for _ <- 1..5 do
        kill_warden(robot)
        assert Safety.state(robot) == :disarming
        assert Safety.disarm(robot) == {:error, :already_disarming}
      end

      send(held, :go_on)
      assert Task.await(disarming, :infinity) == :ok
      assert Safety.state(robot) == :disarmed
      assert runs(robot) == {1, 1}
    end

    test "a disarming goes on, and what hangs has the time that is left of its timeout" do
      {robot, _root} = start()
      Brake.script(robot, @a, disarm: fn _opts -> Process.sleep(:infinity) end)
      :ok = Safety.arm(robot)
      disarming = Task.async(fn -> Safety.disarm(robot, timeout: 300) end)
      assert eventually(fn -> runs(robot) == {1, 1} end)
      kill_warden(robot)

      assert Task.await(disarming, :infinity) ==
               {:error, {:disarm_failed, [{@a, {:timeout, 300}}]}}
    end

    test "a handler that was killed while nobody watched has failed" do
      {robot, _root} = start()
      {held, disarming} = hold_disarming(robot)
      :sys.suspend(warden(robot))
      Process.exit(held, :kill)
      kill_warden(robot)
      assert {:error, {:disarm_failed, [{@a, {:exit, _}}]}} = Task.await(disarming, :infinity)
      assert runs(robot) == {1, 1}
    end

    test "killed again and again among blows to the robot, each disarm runs as often as the other, once a disarming" do
      {robot, root} = start()
      killer = spawn_link(fn -> kill_again_and_again(robot) end)

      # More than three deaths in five seconds would end the root.
      for n <- 1..15 do
        assert eventually(fn -> Safety.arm(robot) == :ok end)

        if rem(n, 4) == 0 do
          end_process(topology(root), :kill)
          assert eventually(fn -> Safety.force_disarm(robot) == :ok end)
        else
          Safety.disarm(robot)
        end

        assert eventually(fn -> Safety.state(robot) == :disarmed end)
        assert {n, runs(robot)} == {n, {n, n}}
        assert_up_again(robot)
      end

      Process.unlink(killer)
      Process.exit(killer, :kill)
    end

    defp kill_again_and_again(robot) do
      if pid = warden(robot), do: Process.exit(pid, :kill)
      Process.sleep(:rand.uniform(20))
      kill_again_and_again(robot)
    end
  end

  # Blows

  defp strike(:topology, root) do
    topology = topology(root)
    end_process(topology, :kill)
    assert eventually(fn -> topology(root) not in [topology, :restarting] end, 30_000)
  end

  defp strike(:root, root), do: end_process(root, :kill)
  defp strike(:stop, root), do: Supervisor.stop(root)

  defp end_process(pid, reason) do
    ref = Process.monitor(pid)
    Process.exit(pid, reason)

    # An exit with another reason than its parent's says nothing to a supervisor.
    unless reason == :kill, do: Supervisor.stop(pid, reason)
    assert_receive {:DOWN, ^ref, _, _, _}
  end

  defp kill_warden(robot) do
    pid = eventually(fn -> warden(robot) end)
    ref = Process.monitor(pid)
    Process.exit(pid, :kill)
    assert_receive {:DOWN, ^ref, _, _, _}
  end

  # Looks

  defp warden(robot), do: Process.whereis(Module.concat(robot, "Safety"))
  defp runs(robot), do: {Brake.runs(robot, @a), Brake.runs(robot, @b)}

  defp topology(root) do
    {_id, pid, _, _} =
      root |> Supervisor.which_children() |> List.keyfind(BB.TopologySupervisor, 0)

    pid
  end

  defp hold_disarming(robot) do
    test = self()

    Brake.script(robot, @a,
      disarm: fn _opts ->
        ref = Process.monitor(test)
        send(test, {:held, self()})

        receive do
          :go_on -> :ok
          {:DOWN, ^ref, _, _, _} -> :ok
        end
      end
    )

    :ok = Safety.arm(robot)
    disarming = Task.async(fn -> Safety.disarm(robot, timeout: 60_000) end)
    assert_receive {:held, held}
    {held, disarming}
  end

  defp assert_disarmed_state(robot),
    do: assert(eventually(fn -> Safety.state(robot) == :disarmed end))

  defp assert_up_again(robot), do: assert(await_all_up(robot))

  defp assert_forgotten(robot) do
    assert eventually(fn -> not Safety.Records.known?(robot) end)
    assert Safety.state(robot) == :disarmed
    assert Safety.arm(robot) == {:error, :not_registered}
    assert eventually(fn -> warden(robot) == nil end)
  end
end
