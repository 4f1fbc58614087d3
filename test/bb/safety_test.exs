defmodule BB.SafetyTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Safety
  alias BB.StateMachine.Transition
  alias BB.Test.{Brake, Probe}

  doctest BB.Safety
  doctest BB.Safety.Events
  doctest BB.Safety.Record

  defmodule Gripper do
    @moduledoc "An actuator that is counted as `BB.Test.Brake` is."
    use BB.Actuator

    @impl BB.Actuator
    def init(opts), do: {:ok, opts}

    @impl BB.Actuator
    def disarm(opts), do: Brake.disarm(opts)

    @impl BB.Actuator
    def handle_command(_message, opts), do: {:noreply, opts}
  end

  @a [:base, :a]
  @b [:base, :b]

  # A robot without processes of its own: this test stands in for them.
  defp bare(paths \\ [@a]) do
    robot = Module.concat(__MODULE__, "Bare#{System.unique_integer([:positive])}")
    for path <- paths, do: :ok = Brake.register(robot, path)
    robot
  end

  defp with_brakes do
    robot do
      topology do
        link :base do
          sensor :a, {BB.Test.Brake, force: 3}
          sensor :b, BB.Test.Brake
          sensor :plain, BB.Test.Probe
        end
      end
    end
  end

  defp start_with_brakes(robot \\ with_brakes()) do
    start_supervised!(robot)
    assert BB.Test.Robot.await_all_up(robot)
    robot
  end

  describe "armed?/1 and state/1" do
    test "of an unknown robot are false and :disarmed" do
      refute Safety.armed?(__MODULE__.Unknown)
      assert Safety.state(__MODULE__.Unknown) == :disarmed
    end

    test "of a robot that was started are false and :disarmed until it is armed" do
      robot = start_with_brakes()
      refute Safety.armed?(robot)
      assert Safety.state(robot) == :disarmed
      :ok = Safety.arm(robot)
      assert Safety.armed?(robot)
      assert Safety.state(robot) == :armed
    end

    test "wait for nobody" do
      robot = bare()
      :ok = Safety.arm(robot)
      :sys.suspend(warden(robot))
      assert Safety.armed?(robot)
      assert Safety.state(robot) == :armed
      :sys.resume(warden(robot))
    end
  end

  describe "arm/1" do
    test "arms a disarmed robot" do
      assert Safety.arm(bare()) == :ok
    end

    test "refuses an armed one: :already_armed" do
      robot = bare()
      :ok = Safety.arm(robot)
      assert Safety.arm(robot) == {:error, :already_armed}
    end

    test "refuses one whose disarming is under way: :disarming" do
      robot = bare()
      {disarming, go_on} = hold_disarming(robot)
      assert Safety.arm(robot) == {:error, :disarming}
      go_on.()
      assert Task.await(disarming, :infinity) == :ok
      assert Safety.arm(robot) == :ok
    end

    test "refuses one in error: :in_error" do
      robot = in_error()
      assert Safety.arm(robot) == {:error, :in_error}
    end

    test "refuses one that is not started: :not_registered" do
      assert Safety.arm(with_brakes()) == {:error, :not_registered}
      robot = start_with_brakes()
      stop_supervised!(robot)
      assert Safety.arm(robot) == {:error, :not_registered}
    end
  end

  describe "disarm/2" do
    test "runs every handler once, and is :ok when all are" do
      robot = bare([@a, @b])
      :ok = Safety.arm(robot)
      assert Safety.disarm(robot) == :ok
      assert Safety.state(robot) == :disarmed
      assert runs(robot) == {1, 1}
    end

    test "refuses a disarmed robot: :already_disarmed, and runs nothing" do
      robot = bare()
      assert Safety.disarm(robot) == {:error, :already_disarmed}
      assert Brake.runs(robot, @a) == 0
    end

    test "refuses one whose disarming is under way: :already_disarming" do
      robot = bare()
      {disarming, go_on} = hold_disarming(robot)
      assert Safety.state(robot) == :disarming
      refute Safety.armed?(robot)
      assert Safety.disarm(robot) == {:error, :already_disarming}
      go_on.()
      assert Task.await(disarming, :infinity) == :ok
      assert Brake.runs(robot, @a) == 1
    end

    test "refuses one in error: :already_in_error" do
      robot = in_error()
      assert Safety.disarm(robot) == {:error, :already_in_error}
      assert Brake.runs(robot, @a) == 1
    end

    test "refuses one that is not started: :not_registered" do
      assert Safety.disarm(with_brakes()) == {:error, :not_registered}
    end

    test "without any handler is :ok" do
      robot = robot(do: sensors(do: sensor(:plain, BB.Test.Probe)))
      start_supervised!(robot)
      :ok = Safety.arm(robot)
      assert Safety.disarm(robot) == :ok
    end

    test "takes timeout: in milliseconds, and raises at anything else" do
      for wrong <- [0, 1.5, :infinity, nil],
          do: assert_raise(ArgumentError, fn -> Safety.disarm(bare(), timeout: wrong) end)

      assert_raise ArgumentError, fn -> Safety.disarm(bare(), time: 1) end
    end
  end

  describe "the error of a handler is" do
    for {what, body, error} <- [
          {"{:returned_error, r}", quote(do: {:error, :stuck}), {:returned_error, :stuck}},
          {"{:returned_error, {:bad_return_value, term}} for what is neither :ok nor {:error, r}",
           quote(do: :done), {:returned_error, {:bad_return_value, :done}}},
          {"{:exception, msg}", quote(do: raise("no bus")), {:exception, "no bus"}},
          {"{:exception, msg} for an error of Erlang's", quote(do: :erlang.error(:badarg)),
           {:exception, "argument error"}},
          {"{:throw, reason}", quote(do: throw(:ball)), {:throw, :ball}},
          {"{:exit, reason}", quote(do: exit(:enough)), {:exit, :enough}},
          {"{:exit, reason} for an exit that says :normal", quote(do: exit(:normal)),
           {:exit, :normal}},
          {"{:exit, :killed} when it is killed", quote(do: Process.exit(self(), :kill)),
           {:exit, :killed}},
          {"{:exit, reason} when a process that it is linked to fails",
           quote(
             do:
               (
                 spawn_link(fn -> exit(:helper) end)
                 Process.sleep(:infinity)
               )
           ), {:exit, :helper}}
        ] do
      test what do
        robot = bare([@a, @b])
        Brake.script(robot, @a, disarm: fn _opts -> unquote(body) end)
        :ok = Safety.arm(robot)

        assert Safety.disarm(robot) ==
                 {:error, {:disarm_failed, [{@a, unquote(Macro.escape(error))}]}}

        assert Safety.state(robot) == :error
        assert runs(robot) == {1, 1}
      end
    end

    test "{:timeout, ms} when it hangs, and it is killed" do
      robot = bare([@a, @b])
      test = self()

      hang = fn _opts ->
        send(test, {:hanging, self()})
        Process.sleep(:infinity)
      end

      Brake.script(robot, @b, disarm: hang)
      :ok = Safety.arm(robot)
      disarming = Task.async(fn -> Safety.disarm(robot, timeout: 50) end)
      assert_receive {:hanging, hanging}
      ref = Process.monitor(hanging)
      assert {:error, {:disarm_failed, failures}} = Task.await(disarming, :infinity)
      assert {@b, {:timeout, 50}} in failures
      assert_receive {:DOWN, ^ref, _, _, _}
    end

    test "given for each of several" do
      robot = bare([@a, @b])
      Brake.script(robot, @a, disarm: fn _opts -> {:error, 1} end)
      Brake.script(robot, @b, disarm: fn _opts -> raise "2" end)
      :ok = Safety.arm(robot)

      assert Safety.disarm(robot) ==
               {:error, {:disarm_failed, [{@a, {:returned_error, 1}}, {@b, {:exception, "2"}}]}}
    end
  end

  test "all handlers run at once" do
    paths = for n <- 1..50, do: [:"brake_#{n}"]
    robot = bare(paths)
    meeting = :counters.new(1, [])

    for path <- paths do
      Brake.script(robot, path,
        disarm: fn _opts ->
          :counters.add(meeting, 1, 1)
          eventually(fn -> :counters.get(meeting, 1) == 50 end) && :ok
        end
      )
    end

    :ok = Safety.arm(robot)
    assert Safety.disarm(robot, timeout: 30_000) == :ok
  end

  describe "force_disarm/1" do
    test "takes a robot out of its error, and runs nothing" do
      robot = in_error()
      assert Safety.force_disarm(robot) == :ok
      assert Safety.state(robot) == :disarmed
      assert Brake.runs(robot, @a) == 1
      assert Safety.arm(robot) == :ok
    end

    test "refuses a robot that is not in error: :not_in_error" do
      robot = bare()
      assert Safety.force_disarm(robot) == {:error, :not_in_error}
      :ok = Safety.arm(robot)
      assert Safety.force_disarm(robot) == {:error, :not_in_error}
    end

    test "refuses one that is not started: :not_registered" do
      assert Safety.force_disarm(with_brakes()) == {:error, :not_registered}
    end
  end

  describe "epoch/1" do
    test "is {:ok, int} while the robot is armed, a new one for each arming" do
      robot = bare()
      assert Safety.epoch(robot) == :error
      :ok = Safety.arm(robot)
      {:ok, first} = Safety.epoch(robot)
      assert first > 0
      {:error, :already_armed} = Safety.arm(robot)
      assert Safety.epoch(robot) == {:ok, first}
      :ok = Safety.disarm(robot)
      assert Safety.epoch(robot) == :error
      :ok = Safety.arm(robot)
      {:ok, second} = Safety.epoch(robot)
      assert second > first
    end

    test "is not used again after the robot was started anew" do
      robot = start_with_brakes()
      :ok = Safety.arm(robot)
      {:ok, first} = Safety.epoch(robot)
      stop_supervised!(robot)
      start_with_brakes(robot)
      :ok = Safety.arm(robot)
      {:ok, second} = Safety.epoch(robot)
      assert second > first
    end

    test "is gone when the first handler runs, and stays gone in error and after force_disarm" do
      robot = start_with_brakes()
      test = self()

      Brake.script(robot, @a,
        disarm: fn _opts ->
          send(test, {:during, Safety.epoch(robot), Safety.disarming?(robot)})
          {:error, :stuck}
        end
      )

      :ok = Safety.arm(robot)
      assert {:error, {:disarm_failed, _}} = Safety.disarm(robot)
      assert_received {:during, :error, true}
      assert {Safety.epoch(robot), Safety.in_error?(robot)} == {:error, true}
      :ok = Safety.force_disarm(robot)
      assert {Safety.epoch(robot), Safety.in_error?(robot)} == {:error, false}
    end

    test "of a robot that is not started is :error" do
      assert Safety.epoch(__MODULE__.Unknown) == :error
    end
  end

  describe "register/2" do
    test "gives a path one handler: the later takes the place of the earlier" do
      robot = bare()
      :ok = Brake.register(robot, @a)
      :ok = Safety.arm(robot)
      :ok = Safety.disarm(robot)
      assert Brake.runs(robot, @a) == 1
    end

    test "raises at a module without disarm/1, and at what is no path" do
      assert_raise ArgumentError, ~r/a module with disarm\/1, got: BB.Test.Probe/, fn ->
        Safety.register(Probe, robot: __MODULE__.Unknown, path: @a, opts: [])
      end

      assert_raise ArgumentError, ~r/expected a path/, fn ->
        Safety.register(Brake, robot: __MODULE__.Unknown, path: :a, opts: [])
      end
    end

    test "while the robot is disarming counts for the next disarming" do
      robot = bare()
      {disarming, go_on} = hold_disarming(robot)
      :ok = Brake.register(robot, @b)
      go_on.()
      :ok = Task.await(disarming, :infinity)
      assert runs(robot) == {1, 0}
      :ok = Safety.arm(robot)
      Brake.script(robot, @a, disarm: fn _ -> :ok end)
      :ok = Safety.disarm(robot)
      assert runs(robot) == {2, 1}
    end
  end

  describe "a component that implements disarm/1" do
    test "is registered by its server, with the options of its init" do
      robot = with_brakes()
      test = self()

      tell = fn what, result ->
        fn opts ->
          send(test, {what, opts})
          result
        end
      end

      Brake.script(robot, @a, init: tell.(:init, {:ok, nil}), disarm: tell.(:disarm, :ok))
      start_supervised!(robot)
      assert_receive {:init, opts}
      :ok = Safety.arm(robot)
      :ok = Safety.disarm(robot)
      assert_received {:disarm, ^opts}
      assert opts[:bb] == %{robot: robot, path: @a}
      assert opts[:force] == 3
    end

    test "is registered before its init is called" do
      robot = with_brakes()
      test = self()

      hang = fn _opts ->
        send(test, :in_init)
        Process.sleep(:infinity)
      end

      Brake.script(robot, @a, init: hang)
      start_supervised!(robot)
      assert_receive :in_init
      :ok = Safety.arm(robot)
      :ok = Safety.disarm(robot)
      assert Brake.runs(robot, @a) == 1
    end

    test "is never registered twice for the same path, however often it is started" do
      robot = start_with_brakes()

      for restarts <- 1..3 do
        BB.cast(robot, :a, :crash)
        assert eventually(fn -> match?(%{restarts: ^restarts, state: :up}, health(robot, :a)) end)
      end

      :ok = Safety.arm(robot)
      :ok = Safety.disarm(robot)
      assert runs(robot) == {1, 1}
    end

    test "may be an actuator as well" do
      robot =
        robot do
          topology do
            link :base do
              joint :joint do
                type :fixed
                actuator :gripper, BB.SafetyTest.Gripper
                link :tip
              end
            end
          end
        end

      start_supervised!(robot)
      assert eventually(fn -> BB.call(robot, :gripper, :hello) end)
      :ok = Safety.arm(robot)
      :ok = Safety.disarm(robot)
      assert Brake.runs(robot, [:base, :joint, :gripper]) == 1
    end

    test "is registered anew when a parameter changes its options" do
      robot =
        robot do
          parameters do
            param :force, type: :integer, default: 1
          end

          sensors do
            sensor :brake, {BB.Test.Brake, force: param([:force])}
          end
        end

      test = self()

      Brake.script(robot, [:brake],
        disarm: fn opts ->
          send(test, {:force, opts[:force]})
          :ok
        end
      )

      start_supervised!(robot)
      assert eventually(fn -> health(robot, :brake).state == :up end)
      :ok = BB.Parameter.set(robot, [:force], 7)
      # It answers when it has taken on the change.
      {:error, :not_implemented} = BB.call(robot, :brake, :hello)
      :ok = Safety.arm(robot)
      :ok = Safety.disarm(robot)
      assert_received {:force, 7}
      refute_received {:force, _}
    end

    test "stays registered when its process dies" do
      robot = start_with_brakes()
      :ok = Safety.arm(robot)
      Brake.script(robot, @a, init: fn _opts -> {:stop, :absent} end)
      BB.cast(robot, :a, :crash)
      assert eventually(fn -> health(robot, :a).state == :backoff end)
      :ok = Safety.disarm(robot)
      assert runs(robot) == {1, 1}
    end

    test "is registered also when it is started alone" do
      robot = Module.concat(__MODULE__, Alone)

      start_supervised!(
        {BB.Sensor.Server, __callback_module__: Brake, bb: %{robot: robot, path: @a}}
      )

      :ok = Safety.arm(robot)
      stop_supervised!({BB.Sensor.Server, @a})
      assert eventually(fn -> Brake.runs(robot, @a) == 1 end)
      assert eventually(fn -> not Safety.Records.known?(robot) end)
    end
  end

  test "a handler whose process is dead and whose disarm ran is a handler no longer" do
    robot = bare()
    owner = Brake.register_apart(robot, @b)
    kill(owner)
    :ok = Safety.arm(robot)
    :ok = Safety.disarm(robot)
    assert runs(robot) == {1, 1}
    :ok = Safety.arm(robot)
    :ok = Safety.disarm(robot)
    assert runs(robot) == {2, 1}
  end

  test "a handler whose process is dead and whose disarm failed is one still" do
    robot = bare()
    kill(Brake.register_apart(robot, @b))
    Brake.script(robot, @b, disarm: fn _opts -> {:error, :stuck} end)
    :ok = Safety.arm(robot)
    {:error, _} = Safety.disarm(robot)
    :ok = Safety.force_disarm(robot)
    :ok = Safety.arm(robot)
    {:error, _} = Safety.disarm(robot)
    assert runs(robot) == {2, 2}
  end

  test "a handler that calls BB.Safety gets an answer like anyone" do
    robot = bare()
    test = self()

    Brake.script(robot, @a,
      disarm: fn _opts ->
        answers = {Safety.disarm(robot), Safety.arm(robot), Safety.force_disarm(robot)}
        send(test, {answers, Safety.state(robot), Brake.register(robot, @b)})
        :ok
      end
    )

    :ok = Safety.arm(robot)
    :ok = Safety.disarm(robot)

    assert_received {{{:error, :already_disarming}, {:error, :disarming},
                      {:error, :not_in_error}}, :disarming, :ok}
  end

  describe "report_error/3" do
    test "publishes BB.Safety.HardwareError on [:safety, :error]" do
      robot = start_with_brakes()
      {:ok, _} = BB.subscribe(robot, [:safety, :error])
      assert Safety.report_error(robot, @a, {:overheated, 93.5}) == :ok

      assert_receive {:bb, [:safety, :error], %BB.Message{frame_id: :a, robot: ^robot} = message}

      assert message.payload == %Safety.HardwareError{path: @a, error: {:overheated, 93.5}}
    end

    test "of the robot itself has the path []" do
      robot = start_with_brakes()
      {:ok, _} = BB.subscribe(robot, [:safety])
      :ok = Safety.report_error(robot, [], :brownout)
      assert_receive {:bb, [:safety, :error], %{frame_id: :safety, payload: %{path: []}}}
    end
  end

  describe "each transition" do
    test "publishes BB.StateMachine.Transition on [:state_machine]" do
      robot = start_with_brakes()
      {:ok, _} = BB.subscribe(robot, [:state_machine])
      :ok = Safety.arm(robot)
      :ok = Safety.disarm(robot)
      Brake.script(robot, @a, disarm: fn _opts -> {:error, :stuck} end)
      :ok = Safety.arm(robot)
      {:error, _} = Safety.disarm(robot)
      :ok = Safety.force_disarm(robot)

      for {from, to} <- [
            disarmed: :armed,
            armed: :disarming,
            disarming: :disarmed,
            disarmed: :armed,
            armed: :disarming,
            disarming: :error,
            error: :disarmed
          ] do
        assert_receive {:bb, [:state_machine], %{payload: transition}}
        assert transition == %Transition{from: from, to: to}
      end

      refute_received {:bb, _, _}
    end

    test "is a telemetry event, and a disarming a span" do
      robot = bare()
      test = self()

      handler = fn event, measurements, metadata, _config ->
        if metadata.robot == robot, do: send(test, {event, measurements, metadata})
      end

      spans = [[:bb, :safety, :disarm, :start], [:bb, :safety, :disarm, :stop]]
      BB.Telemetry.attach_many(robot, [[:bb, :safety, :transition] | spans], handler, nil)
      on_exit(fn -> BB.Telemetry.detach(robot) end)

      :ok = Safety.arm(robot)
      {:ok, epoch} = Safety.epoch(robot)
      :ok = Safety.disarm(robot)

      assert_receive {[:bb, :safety, :transition], %{system_time: _},
                      %{from: :disarmed, to: :armed, epoch: ^epoch}}

      assert_receive {[:bb, :safety, :transition], _, %{from: :armed, to: :disarming}}
      assert_receive {[:bb, :safety, :transition], _, %{from: :disarming, to: :disarmed}}

      assert_receive {[:bb, :safety, :disarm, :start], %{monotonic_time: _},
                      %{cause: :requested, telemetry_span_context: span}}

      assert_receive {[:bb, :safety, :disarm, :stop], %{duration: duration},
                      %{failures: [], telemetry_span_context: ^span}}

      assert duration > 0
    end
  end

  describe "inhibit/3" do
    test "forbids arming, with all reasons, until allow/2" do
      robot = bare()
      :ok = Safety.inhibit(robot, [:estop], :pressed)
      :ok = Safety.inhibit(robot, [:lid], :open)
      inhibited = [{[:estop], :pressed}, {[:lid], :open}]
      assert Safety.inhibitions(robot) == inhibited
      assert Safety.arm(robot) == {:error, {:inhibited, inhibited}}
      :ok = Safety.allow(robot, [:estop])
      assert Safety.arm(robot) == {:error, {:inhibited, [{[:lid], :open}]}}
      :ok = Safety.allow(robot, [:lid])
      :ok = Safety.allow(robot, [:lid])
      assert Safety.arm(robot) == :ok
    end

    test "twice for a path leaves the later reason" do
      robot = bare()
      :ok = Safety.inhibit(robot, [:estop], :pressed)
      :ok = Safety.inhibit(robot, [:estop], :wire_broken)
      assert Safety.inhibitions(robot) == [{[:estop], :wire_broken}]
    end

    test "leaves an armed robot armed" do
      robot = bare()
      :ok = Safety.arm(robot)
      :ok = Safety.inhibit(robot, [:estop], :pressed)
      assert Safety.armed?(robot)
      assert Safety.arm(robot) == {:error, :already_armed}
      assert Safety.disarm(robot) == :ok
    end

    test "outlives the process that called it, and the robot" do
      robot = start_with_brakes()
      {pid, ref} = spawn_monitor(fn -> Safety.inhibit(robot, [:estop], :pressed) end)
      assert_receive {:DOWN, ^ref, _, ^pid, :normal}
      stop_supervised!(robot)
      start_with_brakes(robot)
      assert Safety.arm(robot) == {:error, {:inhibited, [{[:estop], :pressed}]}}
    end
  end

  describe "vouch/2" do
    test "takes back what inhibits arming while its process lives, and not a moment longer" do
      robot = bare()
      :ok = Safety.inhibit(robot, [:estop], :starting)
      watcher = watcher(robot, [:estop])
      assert Safety.inhibitions(robot) == []
      assert Safety.arm(robot) == :ok
      :ok = Safety.disarm(robot)
      kill(watcher)
      assert Safety.inhibitions(robot) == [{[:estop], :unattended}]
      assert Safety.arm(robot) == {:error, {:inhibited, [{[:estop], :unattended}]}}
    end

    test "disarms an armed robot when its process ends, however it does" do
      for reason <- [:kill, :shutdown] do
        robot = bare()
        watcher = watcher(robot, [:estop])
        :ok = Safety.arm(robot)
        Process.exit(watcher, reason)
        assert eventually(fn -> Safety.state(robot) == :disarmed end)
        assert Brake.runs(robot, @a) == 1
      end
    end

    test "of a successor counts, and the end of who vouched before it does not" do
      robot = bare()
      first = watcher(robot, [:estop])
      second = watcher(robot, [:estop])
      :ok = Safety.arm(robot)
      kill(first)
      :sys.get_state(warden(robot))
      assert Safety.armed?(robot)
      kill(second)
      assert eventually(fn -> Safety.state(robot) == :disarmed end)
    end

    test "disarms too when its process forbade arming before it ended" do
      robot = bare()
      watcher = watcher(robot, [:estop])
      :ok = Safety.arm(robot)
      :ok = Safety.inhibit(robot, [:estop], :pressed)
      assert Safety.armed?(robot)
      kill(watcher)
      assert eventually(fn -> Safety.state(robot) == :disarmed end)
      assert Safety.arm(robot) == {:error, {:inhibited, [{[:estop], :pressed}]}}
    end

    test "is over with allow/2, and the process may end without consequence" do
      robot = bare()
      watcher = watcher(robot, [:estop])
      :ok = Safety.allow(robot, [:estop])
      :ok = Safety.arm(robot)
      kill(watcher)
      :sys.get_state(warden(robot))
      assert Safety.armed?(robot)
    end

    test "holds over a crash of the safety process" do
      robot = start_with_brakes()
      watcher = watcher(robot, [:estop])
      :ok = Safety.arm(robot)
      kill(warden(robot))
      assert eventually(fn -> warden(robot) end)
      assert Safety.armed?(robot)
      kill(watcher)
      assert eventually(fn -> Safety.state(robot) == :disarmed end)
    end

    defp watcher(robot, path) do
      test = self()

      watcher =
        spawn(fn ->
          :ok = Safety.vouch(robot, path)
          send(test, {:vouched, self()})
          Process.sleep(:infinity)
        end)

      assert_receive {:vouched, ^watcher}
      watcher
    end
  end

  describe "a component with inhibition/0" do
    defmodule Watcher do
      @moduledoc "Says that the robot may be armed when it is told to."
      use BB.Sensor

      @impl BB.Sensor
      def inhibition, do: :not_watched

      @impl BB.Sensor
      def init(opts), do: {:ok, opts[:bb]}

      @impl BB.Sensor
      def handle_call(:vouch, _from, bb), do: {:reply, Safety.vouch(bb.robot, bb.path), bb}
    end

    test "keeps its robot from being armed until it says otherwise" do
      robot =
        robot do
          topology do
            link :base do
              sensor :watcher, BB.SafetyTest.Watcher
            end
          end
        end

      start_supervised!(robot)
      refused = {:error, {:inhibited, [{[:base, :watcher], :not_watched}]}}
      assert Safety.arm(robot) == refused
      assert eventually(fn -> BB.Process.whereis(robot, :watcher) != :undefined end)
      :ok = BB.call(robot, :watcher, :vouch)
      assert Safety.arm(robot) == :ok
      stop_supervised!(robot)
      start_supervised!(robot)
      assert Safety.arm(robot) == refused
    end
  end

  describe "arming and disarming by many at once" do
    test "lets one of them at a time, and runs each handler once a disarming" do
      robot = bare([@a, @b])

      answers =
        1..8
        |> Enum.map(fn n ->
          Task.async(fn ->
            for k <- 1..50, do: if(rem(n + k, 2) == 0, do: Safety.arm(robot), else: disarm(robot))
          end)
        end)
        |> Enum.flat_map(&Task.await(&1, :infinity))

      armed = Enum.count(answers, &(&1 == :ok))
      disarmed = Enum.count(answers, &(&1 == :disarmed))
      assert armed - disarmed == if(Safety.armed?(robot), do: 1, else: 0)
      assert runs(robot) == {disarmed, disarmed}

      assert Enum.all?(
               answers,
               &(&1 in [
                   :ok,
                   :disarmed,
                   {:error, :already_armed},
                   {:error, :disarming},
                   {:error, :already_disarmed},
                   {:error, :already_disarming}
                 ])
             )
    end

    defp disarm(robot) do
      with :ok <- Safety.disarm(robot, timeout: 60_000), do: :disarmed
    end
  end

  # The state machine against a plain model: random requests, handlers that fail, processes that are killed.

  @paths [[:p1], [:p2], [:p3]]
  @behaviours [:well, :error, :raise, :throw, :exit, :kill]

  property "the state machine does as a plain model does, whatever is killed meanwhile",
    numtests: 150 do
    forall commands <- list(command()) do
      robot = bare([])
      :ok = Brake.register(robot, [:anchor])
      world = %{owners: %{}}
      model = %{state: :disarmed, handlers: %{[:anchor] => :alive}, behaves: %{}, inhibited: []}

      Enum.reduce(commands, {world, model, %{}}, fn command, {world, model, runs} ->
        {expected, model, ran} = expect(command, model)
        {answer, world} = perform(command, robot, world)
        assert {command, answer} == {command, expected}
        assert {command, Safety.state(robot)} == {command, model.state}
        runs = Enum.reduce(ran, runs, &Map.update(&2, &1, 1, fn n -> n + 1 end))

        for path <- [[:anchor] | @paths],
            do: assert({path, Brake.runs(robot, path)} == {path, Map.get(runs, path, 0)})

        {world, model, runs}
      end)

      true
    end
  end

  defp command do
    frequency([
      {6, oneof([:arm, :disarm])},
      {1, :force_disarm},
      {1, :kill_warden},
      {2, tuple([oneof([:register, :end_owner]), oneof(@paths)])},
      {1, tuple([oneof([:inhibit, :allow]), oneof(@paths)])},
      {2, tuple([:behave, oneof([[:anchor] | @paths]), oneof(@behaviours)])}
    ])
  end

  defp expect(:arm, %{state: :disarmed, inhibited: []} = m), do: {:ok, %{m | state: :armed}, []}

  defp expect(:arm, %{state: :disarmed} = m),
    do: {{:error, {:inhibited, for(path <- m.inhibited, do: {path, :because})}}, m, []}

  defp expect(:arm, %{state: :armed} = m), do: {{:error, :already_armed}, m, []}
  defp expect(:arm, %{state: :error} = m), do: {{:error, :in_error}, m, []}

  defp expect(:disarm, %{state: :armed} = m) do
    failures =
      for {path, _} <- Enum.sort(m.handlers), error = failure(m.behaves[path]), do: {path, error}

    handlers =
      for {path, alive} <- m.handlers,
          alive == :alive or failure(m.behaves[path]),
          into: %{},
          do: {path, alive}

    ran = Map.keys(m.handlers)

    if failures == [],
      do: {:ok, %{m | state: :disarmed, handlers: handlers}, ran},
      else: {{:error, {:disarm_failed, failures}}, %{m | state: :error, handlers: handlers}, ran}
  end

  defp expect(:disarm, %{state: :disarmed} = m), do: {{:error, :already_disarmed}, m, []}
  defp expect(:disarm, %{state: :error} = m), do: {{:error, :already_in_error}, m, []}
  defp expect(:force_disarm, %{state: :error} = m), do: {:ok, %{m | state: :disarmed}, []}
  defp expect(:force_disarm, m), do: {{:error, :not_in_error}, m, []}
  defp expect(:kill_warden, m), do: {:ok, m, []}
  defp expect({:register, path}, m), do: {:ok, put_in(m.handlers[path], :alive), []}

  defp expect({:end_owner, path}, m) do
    if m.handlers[path], do: {:ok, put_in(m.handlers[path], :dead), []}, else: {:ok, m, []}
  end

  defp expect({:inhibit, path}, m),
    do: {:ok, %{m | inhibited: Enum.sort(Enum.uniq([path | m.inhibited]))}, []}

  defp expect({:allow, path}, m), do: {:ok, %{m | inhibited: List.delete(m.inhibited, path)}, []}
  defp expect({:behave, path, how}, m), do: {:ok, put_in(m.behaves[path], how), []}

  defp failure(:error), do: {:returned_error, :stuck}
  defp failure(:raise), do: {:exception, "stuck"}
  defp failure(:throw), do: {:throw, :stuck}
  defp failure(:exit), do: {:exit, :stuck}
  defp failure(:kill), do: {:exit, :killed}
  defp failure(_well), do: nil

  defp perform(:arm, robot, world), do: {Safety.arm(robot), world}
  defp perform(:disarm, robot, world), do: {Safety.disarm(robot, timeout: 60_000), world}
  defp perform(:force_disarm, robot, world), do: {Safety.force_disarm(robot), world}

  defp perform(:kill_warden, robot, world) do
    if pid = warden(robot), do: Process.exit(pid, :kill)
    {:ok, world}
  end

  defp perform({:register, path}, robot, world),
    do: {:ok, put_in(world.owners[path], Brake.register_apart(robot, path))}

  defp perform({:end_owner, path}, _robot, world) do
    if owner = world.owners[path], do: kill(owner)
    {:ok, world}
  end

  defp perform({:inhibit, path}, robot, world),
    do: {Safety.inhibit(robot, path, :because), world}

  defp perform({:allow, path}, robot, world), do: {Safety.allow(robot, path), world}

  defp perform({:behave, path, how}, robot, world) do
    Brake.script(robot, path, disarm: fn _opts -> behave(how) end)
    {:ok, world}
  end

  defp behave(:well), do: :ok
  defp behave(:error), do: {:error, :stuck}
  defp behave(:raise), do: raise("stuck")
  defp behave(:throw), do: throw(:stuck)
  defp behave(:exit), do: exit(:stuck)
  defp behave(:kill), do: Process.exit(self(), :kill)

  # Helpers

  # An armed robot's disarming that waits for the function that is returned.
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
    {disarming, fn -> send(held, :go_on) end}
  end

  defp in_error do
    robot = bare()
    Brake.script(robot, @a, disarm: fn _opts -> {:error, :stuck} end)
    :ok = Safety.arm(robot)
    {:error, {:disarm_failed, _}} = Safety.disarm(robot)
    Brake.script(robot, @a, disarm: fn _opts -> :ok end)
    robot
  end

  defp runs(robot), do: {Brake.runs(robot, @a), Brake.runs(robot, @b)}
  defp warden(robot), do: Process.whereis(Module.concat(robot, "Safety"))

  defp kill(pid) do
    ref = Process.monitor(pid)
    Process.exit(pid, :kill)
    assert_receive {:DOWN, ^ref, _, _, _}
  end
end
