defmodule BB.Firmware.GateTest do
  use ExUnit.Case, async: true

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
    opts = [robot: robot, name: gate, board: {Memory, memory}, public_key: key, settle_ms: 0]
    start_supervised!({Gate, opts})
    %{robot: robot, memory: memory, key: key, gate: gate}
  end

  # An uploader as the SSH channel is one: it asks, writes, and ends.
  defp upload(gate) do
    test = self()

    {:ok, pid} =
      Task.start(fn ->
        send(test, {:answer, self(), Gate.precheck(gate)})
        receive do: (:end -> :ok)
      end)

    assert_receive {:answer, ^pid, answer}
    {pid, answer}
  end

  test "an update is let in with the key that its signature must fit", %{gate: gate, key: key} do
    assert {_, {:ok, [fwup_extra_options: ["--public-key-file", ^key]]}} = upload(gate)
  end

  test "an update is refused while the robot is armed", %{gate: gate, robot: robot} do
    :ok = Safety.arm(robot)
    assert {_, {:error, "the robot is armed: disarm it first\n"}} = upload(gate)
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
    assert {_, {:error, "no signature could be checked" <> _}} = upload(gate)
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
    assert {_, {:error, "an update has been written" <> _}} = upload(context.gate)
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

  test "an update is refused when there is no gate" do
    assert Gate.precheck(:no_gate_of_this_name) ==
             {:error, "the gate for updates does not answer\n"}
  end
end
