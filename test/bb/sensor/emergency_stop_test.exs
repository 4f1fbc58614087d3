defmodule BB.Sensor.EmergencyStopTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually

  alias BB.Bus.Sim.{Contact, Lines}
  alias BB.Safety
  alias BB.Test.Robot

  @stop [:base, :estop]
  @pressed {:error, {:inhibited, [{@stop, :pressed}]}}

  setup context do
    chip = "gpiochip-estop-#{System.unique_integer([:positive])}"
    contact = {Contact, [pins: [contact: 27], normally: :closed] ++ (context[:contact] || [])}
    start_supervised!({Lines, chips: %{chip => [devices: %{button: contact}]}})
    options = [line: {chip, 27}] ++ (context[:options] || [])

    robot =
      Robot.create(
        quote do
          parameters do
            param :release, type: :float, default: 0.02
          end

          topology do
            link :base do
              sensor :estop,
                     {BB.Sensor.EmergencyStop,
                      unquote(Macro.escape(options)) ++ [release: param([:release])]}

              sensor :brake, BB.Test.Brake
            end
          end
        end
      )

    %{robot: robot, chip: chip, wire: {chip, 27}}
  end

  defp start!(%{robot: robot}) do
    start_supervised!(robot)
    await_up(robot)
  end

  defp await_up(robot) do
    assert eventually(fn -> Robot.health(robot, :estop).state == :up end)
    robot
  end

  defp armed!(context) do
    robot = start!(context)
    :ok = Safety.arm(robot)
    {:ok, _} = BB.subscribe(robot, [:sensor, :base, :estop])
    robot
  end

  defp assert_disarmed(robot) do
    assert eventually(fn -> Safety.state(robot) == :disarmed end)
    assert BB.Test.Brake.runs(robot, [:base, :brake]) == 1
  end

  defp assert_contact(pressed?) do
    assert_receive {:bb, _, %{payload: %BB.Message.Sensor.Contact{pressed: ^pressed?}}}
  end

  # Readings from before, which are in the mailbox once the robot is disarmed by a later one.
  defp forget_contacts do
    receive do
      {:bb, _, %{payload: %BB.Message.Sensor.Contact{}}} -> forget_contacts()
    after
      0 -> :ok
    end
  end

  test "a robot whose stop is not pressed can be armed", context do
    assert Safety.arm(start!(context)) == :ok
  end

  test "pressing it disarms the robot and is published", context do
    robot = armed!(context)
    :ok = Lines.tell(context.chip, :button, :press)
    assert_contact(true)
    assert_disarmed(robot)
    assert Safety.arm(robot) == @pressed
  end

  test "a wire that breaks is the same as pressing it", context do
    robot = armed!(context)
    :ok = Lines.fault(context.wire, :cut)
    assert_disarmed(robot)
    assert Safety.arm(robot) == @pressed
  end

  test "so is a plug that is pulled out", context do
    robot = armed!(context)
    :ok = Lines.unplug(context.chip, :button)
    assert_disarmed(robot)
    assert Safety.arm(robot) == @pressed
  end

  test "a contact that opens only for a moment is a stop", context do
    robot = armed!(context)
    :ok = Lines.tell(context.chip, :button, :press)
    :ok = Lines.tell(context.chip, :button, :release)
    assert_disarmed(robot)
  end

  test "released, it allows arming, and leaves the robot disarmed", context do
    robot = armed!(context)
    :ok = Lines.tell(context.chip, :button, :press)
    assert_disarmed(robot)
    forget_contacts()
    :ok = Lines.tell(context.chip, :button, :release)
    assert_contact(false)
    assert Safety.state(robot) == :disarmed
    assert Safety.arm(robot) == :ok
  end

  test "pressed before the robot is started, it cannot be armed at all", context do
    :ok = Lines.tell(context.chip, :button, :press)
    robot = start!(context)
    assert Safety.arm(robot) == @pressed
  end

  test "before its driver has looked, the robot cannot be armed", context do
    :ok = Lines.fault(context.wire, :busy)
    start_supervised!(context.robot)
    assert {:error, {:inhibited, [{@stop, reason}]}} = Safety.arm(context.robot)
    assert reason in [:not_started, :starting, :failed]

    assert eventually(fn -> Robot.health(context.robot, :estop).state == :backoff end)
    assert Safety.arm(context.robot) == {:error, {:inhibited, [{@stop, :failed}]}}
    :ok = Lines.clear(context.wire)
    await_up(context.robot)
    assert Safety.arm(context.robot) == :ok
  end

  test "when its driver is killed the robot is disarmed, and stays so until another has looked",
       context do
    robot = armed!(context)
    :ok = Lines.fault(context.wire, {:short, 0})
    Process.exit(BB.Process.whereis(robot, :estop), :kill)
    assert_disarmed(robot)
    await_up(robot)
    assert eventually(fn -> Safety.arm(robot) == :ok end)
  end

  test "killed repeatedly, it never leaves the robot armed and unwatched", context do
    robot = start!(context)
    test = self()

    {:ok, _} = BB.subscribe(robot, [:state_machine])

    armer =
      spawn_link(fn ->
        Stream.repeatedly(fn -> Safety.arm(robot) end)
        |> Enum.each(fn result -> if result == :ok, do: send(test, :armed) end)
      end)

    for _ <- 1..10 do
      assert_receive :armed
      pid = eventually(fn -> alive(BB.Process.whereis(robot, :estop)) end)
      Process.exit(pid, :kill)

      assert_receive {:bb, [:state_machine], %{payload: %{from: :armed, to: :disarming}}}
    end

    Process.unlink(armer)
    Process.exit(armer, :kill)
  end

  test "its keeper killed with it, the robot is disarmed too", context do
    robot = armed!(context)
    Process.exit(Robot.keeper(robot, :estop), :kill)
    assert_disarmed(robot)
  end

  test "a line that is lost disarms the robot, and the sensor stops with the reason", context do
    robot = armed!(context)
    :ok = Lines.fault(context.wire, :busy)
    assert_disarmed(robot)
    assert eventually(fn -> Robot.health(robot, :estop).state == :backoff end)
    assert Safety.arm(robot) == {:error, {:inhibited, [{@stop, :failed}]}}
    row = Robot.health(robot, :estop)
    assert BB.Sensor.explain(BB.Sensor.EmergencyStop, row.last_error) =~ context.chip
  end

  test "a storm of edges disarms the robot and takes the sensor down with :noise", context do
    robot = armed!(context)
    :ok = Lines.fault(context.wire, {:storm, 5_000})
    assert_disarmed(robot)
    noise = {:noise, context.wire}
    assert eventually(fn -> Robot.health(robot, :estop).last_error == noise end)
    assert {:error, {:inhibited, [{@stop, _reason}]}} = Safety.arm(robot)
    :ok = Lines.clear(context.wire)
    assert eventually(fn -> Safety.arm(robot) == :ok end)
  end

  test "new options disarm the robot, which can be armed when the contact is closed with them",
       context do
    robot = armed!(context)
    :ok = BB.Parameter.set(robot, [:release], 0.03)
    assert_disarmed(robot)
    assert eventually(fn -> Safety.arm(robot) == :ok end)
    :ok = Lines.tell(context.chip, :button, :press)
    assert eventually(fn -> Safety.state(robot) == :disarmed end)
    assert Safety.arm(robot) == @pressed
  end

  test "a restarted robot cannot be armed before the contact was read", context do
    robot = armed!(context)
    stop_supervised!(robot)
    :ok = Lines.tell(context.chip, :button, :press)
    start!(context)
    assert Safety.arm(robot) == @pressed
  end

  @tag contact: [to: :supply]
  @tag options: [closed: :high]
  test "a contact to the supply is pulled the other way", context do
    robot = armed!(context)
    :ok = Lines.fault(context.wire, :cut)
    assert_disarmed(robot)
  end

  defp alive(pid) when is_pid(pid), do: pid
  defp alive(:undefined), do: nil
end
