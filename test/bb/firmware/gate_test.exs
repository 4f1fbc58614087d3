defmodule BB.Firmware.GateTest do
  # An update concerns every robot of the VM: those of other tests must not be armed meanwhile.
  use ExUnit.Case, async: false

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Firmware.Board.Memory
  alias BB.Firmware.Gate
  alias BB.Safety

  @moduletag :tmp_dir

  setup %{tmp_dir: tmp_dir} do
    robot =
      robot do
        topology do
          link :base_link do
          end
        end
      end

    start_supervised!(robot)
    key = Path.join(tmp_dir, "firmware.pub")
    File.write!(key, "key")
    {:ok, memory} = Memory.start_link(status: :validated, tell: self())

    gate = Module.concat(robot, Gate)
    folder = Path.join(tmp_dir, "guard")
    own = [board: {Memory, memory}, public_key: key, settle_ms: 0, folder: folder]
    start_supervised!({Gate, [robot: robot, name: gate] ++ own})
    on_exit(fn -> forget(gate) end)
    %{robot: robot, memory: memory, key: key, gate: gate, folder: folder, own: own}
  end

  # What belongs to no supervisor ends with its uploader, but for one that has written.
  defp forget(gate) do
    lock = Process.whereis(Module.concat(gate, Lock))
    if lock, do: Process.exit(lock, :kill)
  end

  # An uploader as the SSH channel is one: it asks, writes, and ends.
  defp armed(robot) do
    "robot #{inspect(robot)} is armed; disarm it with BB.Safety.disarm(#{inspect(robot)})\n"
  end

  defp upload(gate, opts \\ []) do
    test = self()

    {:ok, pid} =
      Task.start(fn ->
        send(test, {:answer, self(), Gate.precheck(gate, opts)})
        receive do: (:end -> :ok)
      end)

    assert_receive {:answer, ^pid, answer}, 30_000
    {pid, answer}
  end

  defp finish(uploader) do
    ref = Process.monitor(uploader)
    send(uploader, :end)
    assert_receive {:DOWN, ^ref, :process, ^uploader, _}, 30_000
  end

  test "an update is let in with the key that its signature must fit", %{gate: gate, key: key} do
    assert {_, {:ok, [fwup_extra_options: ["--public-key-file", ^key]]}} = upload(gate)
  end

  test "an update is refused while the robot is armed", %{gate: gate, robot: robot} do
    :ok = Safety.arm(robot)
    assert {_, {:error, text}} = upload(gate)
    assert text == armed(robot)
    assert Safety.inhibitions(robot) == []
  end

  test "an update is refused while the running firmware is not validated", context do
    Memory.answer(context.memory, :validation_status, :unvalidated)
    assert {_, {:error, "the running firmware is not validated yet" <> _}} = upload(context.gate)
    Memory.answer(context.memory, :validation_status, :unknown)
    assert {_, {:ok, _}} = upload(context.gate)
  end

  test "an update is refused when the public key is missing or empty", %{gate: gate, key: key} do
    File.write!(key, "")
    assert {_, {:error, "signatures cannot be checked" <> _}} = upload(gate)
    File.rm!(key)
    assert {_, {:error, text}} = upload(gate)
    assert text =~ "#{key} is missing"
  end

  test "an update is refused while another one is written, and let in after it has failed", %{
    gate: gate
  } do
    {first, {:ok, _}} = upload(gate)
    assert {_, {:error, "another update is being written\n"}} = upload(gate)
    send(first, :end)
    eventually(fn -> match?({_, {:ok, _}}, upload(gate)) end)
  end

  test "the robot cannot be armed while an update is written", %{gate: gate, robot: robot} do
    {first, {:ok, _}} = upload(gate)
    assert Safety.arm(robot) == {:error, {:inhibited, [{[:firmware, :update], :update}]}}
    send(first, :end)
    eventually(fn -> Safety.arm(robot) == :ok end)
  end

  test "a gate that was killed knows whom it has let in", %{gate: gate, robot: robot} do
    {first, {:ok, _}} = upload(gate)
    Process.exit(Process.whereis(gate), :kill)

    eventually(fn -> match?({_, {:error, "another update is being written\n"}}, upload(gate)) end)
    assert [{[:firmware, :update], :update}] = Safety.inhibitions(robot)
    send(first, :end)
    eventually(fn -> match?({_, {:ok, _}}, upload(gate)) end)
  end

  test "after a firmware was written the robot is disarmed, then the board restarted, and nothing else is let in",
       context do
    {_, {:ok, _}} = upload(context.gate)
    assert Gate.written(context.gate) == :ok
    assert_receive {Memory, :reboot}
    assert Safety.state(context.robot) == :disarmed
    assert {_, {:error, "an update was written" <> _}} = upload(context.gate)
  end

  test "a robot that is armed all the same is disarmed before the restart", context do
    :ok = Safety.arm(context.robot)
    {:ok, _} = BB.subscribe(context.robot, [:state_machine])
    assert Gate.written(context.gate) == :ok
    assert {:messages, messages} = Process.info(self(), :messages)

    assert [:disarming, :disarmed, :reboot] =
             for(
               told <- messages,
               do:
                 case told do
                   {:bb, _, message} -> message.payload.to
                   {Memory, call} -> call
                 end
             )
  end

  test "the next upload waits until it is known whether one that has ended wrote anything", %{
    robot: robot,
    own: own
  } do
    gate = Module.concat(robot, Slow)
    opts = [robot: robot, name: gate] ++ Keyword.put(own, :settle_ms, 5_000)
    start_supervised!({Gate, opts}, id: gate)

    # It failed: the next one is let in, and is told of no other.
    {first, {:ok, _}} = upload(gate)
    finish(first)
    {second, {:ok, _}} = upload(gate)
    assert {_, {:error, "another update is being written\n"}} = upload(gate)

    # It succeeded: the next one has waited for that.
    finish(second)
    waiting = Task.async(fn -> Gate.precheck(gate) end)
    assert Gate.written(gate) == :ok
    assert {:error, "an update was written" <> _} = Task.await(waiting, 30_000)
    forget(gate)
  end

  test "two that come at once do not both enter", %{gate: gate} do
    answers =
      for _ <- 1..8, reduce: [] do
        tasks -> [Task.async(fn -> {Gate.precheck(gate), stay()} end) | tasks]
      end

    answers = answers |> Enum.map(&Task.await(&1, 60_000)) |> Enum.map(&elem(&1, 0))
    assert [{:ok, _}] = Enum.filter(answers, &match?({:ok, _}, &1))
  end

  # Longer than the others take to ask.
  defp stay, do: Process.sleep(500)

  test "an update is refused while another robot is armed than the gate's", %{gate: gate} do
    other =
      robot do
        topology do
          link :base_link do
          end
        end
      end

    start_supervised!(other)
    :ok = Safety.arm(other)
    assert {_, {:error, text}} = upload(gate)
    assert text == armed(other)
    :ok = Safety.disarm(other)
    {_, {:ok, _}} = upload(gate)
    assert Safety.arm(other) == {:error, {:inhibited, [{[:firmware, :update], :update}]}}
  end

  test "an update that is let in, and one that is written, are noted", context do
    Memory.answer(context.memory, :validation_status, nil)
    Agent.update(context.memory, &%{&1 | firmware: %{"nerves_fw_uuid" => "old"}})
    {_, {:ok, _}} = upload(context.gate)
    assert File.read!(Path.join(context.folder, "trial.txt")) =~ "state accepted"
    assert Gate.written(context.gate) == :ok
    assert File.read!(Path.join(context.folder, "trial.txt")) =~ "state written"
    assert [line] = BB.Firmware.Story.recent(context.folder)
    assert line =~ "an update was written"
  end

  describe "without a gate" do
    setup %{gate: gate} do
      stop_supervised!(Gate)
      refute Process.whereis(gate)
      :ok
    end

    test "a signed update is let in where nothing is armed, and that is told", context do
      {uploader, {:ok, options}} = upload(context.gate, context.own)
      assert options == [fwup_extra_options: ["--public-key-file", context.key]]
      assert [line] = BB.Firmware.Story.recent(context.folder)
      assert line =~ "without the gate"

      # One at a time all the same, also when what holds the lock is killed.
      busy = {:error, "another update is being written\n"}
      assert {_, ^busy} = upload(context.gate, context.own)
      forget(context.gate)
      assert {_, ^busy} = upload(context.gate, context.own)
      finish(uploader)
      assert {_, {:ok, _}} = upload(context.gate, context.own)
    end

    test "an update is refused without a key, and for what is armed", context do
      :ok = Safety.arm(context.robot)
      assert {_, {:error, refusal}} = upload(context.gate, context.own)
      assert refusal == armed(context.robot)
      :ok = Safety.disarm(context.robot)
      File.rm!(context.key)

      assert {_, {:error, "signatures cannot be checked" <> _}} =
               upload(context.gate, context.own)

      # What is not configured has its default, which the host has not.
      assert {_, {:error, text}} = upload(:no_gate_of_this_name, [])
      assert text =~ "/etc/ganglion/firmware.pub is missing"
    end

    test "no robot can be armed while an update is written", context do
      {uploader, {:ok, _}} = upload(context.gate, context.own)
      assert {:error, {:inhibited, _}} = Safety.arm(context.robot)
      finish(uploader)
      eventually(fn -> Safety.arm(context.robot) == :ok end, 30_000)
    end

    test "a board of which nothing can be told takes an update, one on trial does not", context do
      Memory.answer(context.memory, :validation_status, {:error, :nerves_runtime_is_down})
      {uploader, {:ok, _}} = upload(context.gate, context.own)
      finish(uploader)
      Memory.answer(context.memory, :validation_status, :unvalidated)
      assert {_, {:error, text}} = upload(context.gate, context.own)
      assert text =~ "reverts to the previous firmware"
    end

    test "options that are wrong do not keep an update out", context do
      opts = [settle_ms: "soon", board: :none, robot: 5, nonsense: true] ++ context.own
      assert {_, {:ok, _}} = upload(context.gate, opts)
      assert {_, {:error, text}} = upload(:another_gate, :nonsense)
      assert text =~ "is missing"
    end

    test "the board restarts when the update is written", context do
      :ok = Safety.arm(context.robot)
      assert Gate.written(context.gate, context.own) == :ok
      assert_receive {Memory, :reboot}
      assert Safety.state(context.robot) == :disarmed
      assert Gate.busy?(context.gate)
      assert {_, {:error, "an update was written" <> _}} = upload(context.gate, context.own)
    end

    test "a gate that comes back knows whom was let in", context do
      {uploader, {:ok, _}} = upload(context.gate, context.own)
      Safety.allow(context.robot, [:firmware, :update])
      start_supervised!({Gate, [robot: context.robot, name: context.gate] ++ context.own})
      assert [{[:firmware, :update], :update}] = Safety.inhibitions(context.robot)
      assert {_, {:error, "another update is being written\n"}} = upload(context.gate)
      finish(uploader)
      assert {_, {:ok, _}} = upload(context.gate)
    end
  end
end
