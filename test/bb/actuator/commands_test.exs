defmodule BB.Actuator.CommandsTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
  import ExUnit.CaptureLog

  alias BB.Error.State.{NotArmed, StaleEpoch, UnsupportedCommand}
  alias BB.Message
  alias BB.Message.Actuator.BeginMotion
  alias BB.Message.Actuator.Command.{Effort, Hold, Position, Stop, Trajectory, Velocity}
  alias BB.Options.ValidationError
  alias BB.Test.Servo

  @moduletag :capture_log

  @path [:base, :elbow, :servo]
  @topic [:actuator | @path]
  @six [Effort, Hold, Position, Stop, Trajectory, Velocity]

  setup do
    robot =
      robot do
        topology do
          link :base do
            joint :elbow do
              type :revolute

              limit lower: ~u(-90 degree),
                    upper: ~u(90 degree),
                    effort: ~u(2 newton_meter),
                    velocity: ~u(60 degree_per_second)

              actuator :servo, BB.Test.Servo do
                transmission reduction: 2.0, offset: ~u(1 radian)
              end

              actuator :pusher, {BB.Test.Servo, payloads: [BB.Message.Actuator.Command.Position]}
              sensor :encoder, BB.Test.Probe
              link :arm
            end
          end
        end
      end

    Servo.observe(robot)
    %{robot: robot}
  end

  defp start(robot) do
    start_supervised!(robot)
    assert await_all_up(robot)
    robot
  end

  defp armed(robot) do
    start(robot)
    :ok = BB.Safety.arm(robot)
    robot
  end

  # A command as a program makes it that does not use the functions of BB.Actuator.
  defp command(robot, payload \\ Position, fields \\ [position: 1.5]) do
    message = Message.new!(payload, :servo, fields)

    case BB.Safety.armed?(robot) and BB.Safety.epoch(robot) do
      {:ok, epoch} -> %{message | arm_epoch: epoch}
      _not_armed -> message
    end
  end

  defp call(robot, message, name \\ :servo), do: BB.call(robot, name, {:command, message})

  # Returns when the servo has handled all messages that were sent to it before.
  defp settle(robot, name \\ :servo), do: :own_call = BB.call(robot, name, :settle)

  describe "the start" do
    test "asks for the payloads once, subscribes, then calls init/1 with the motor's profile", %{
      robot: robot
    } do
      test = self()

      Servo.script(robot, :servo,
        command_payloads: fn _ ->
          send(test, {:subscribed, BB.PubSub.subscribers(robot, @topic)})
          [Position, Hold]
        end,
        init: fn state ->
          send(test, {:subscribed_at_init, BB.PubSub.subscribers(robot, @topic)})
          {:ok, state}
        end
      )

      start(robot)
      assert_receive {:servo, :servo, :command_payloads, opts}
      assert opts[:gain] == 1.0
      assert opts[:bb] == %{robot: robot, path: @path}
      assert_receive {:subscribed, []}
      pid = BB.Process.whereis(robot, :servo)
      assert_receive {:servo, :servo, :init, ^opts}
      assert_receive {:subscribed_at_init, [{^pid, [Position, Hold]}]}
      refute_received {:servo, :servo, :command_payloads, _}

      assert %BB.Actuator.MotorProfile{} = profile = opts[:motor_profile]
      quarter = :math.pi() / 2
      assert_in_delta profile.motor_lower, 2.0 * (-quarter - 1.0), 1.0e-9
      assert_in_delta profile.motor_upper, 2.0 * (quarter - 1.0), 1.0e-9
      assert_in_delta profile.motor_velocity_limit, 2.0 * :math.pi() / 3, 1.0e-9
      assert profile.motor_effort_limit == 1.0
      assert profile.motor_acceleration_limit == nil
      assert_in_delta profile.motor_initial_position, -2.0, 1.0e-9
    end

    test "subscribes to the six payloads by default, and to nothing without payloads", %{
      robot: robot
    } do
      Servo.script(robot, :pusher, command_payloads: fn _ -> [] end)
      start(robot)
      pid = BB.Process.whereis(robot, :servo)
      assert [{^pid, @six}] = BB.PubSub.subscribers(robot, @topic)
      assert BB.PubSub.subscribers(robot, [:actuator, :base, :elbow, :pusher]) == []
    end

    test "fails for payloads that are no modules, and the actuator is down", %{robot: robot} do
      Servo.script(robot, :servo, command_payloads: fn _ -> :all end)
      start_supervised!(robot)

      assert eventually(fn ->
               [row | _] = BB.Actuator.health(robot)
               row.state == :backoff and row.error =~ "to return a list of payload modules"
             end)
    end

    test "declares no payload for a driver without handle_command/2", %{robot: robot} do
      options = [bb: %{robot: robot, path: @path}]
      assert BB.Actuator.CommandCheck.start(BB.Test.Brain, options).payloads == []
    end
  end

  describe "a command" do
    test "by call is converted to the motor's space, and accepted", %{robot: robot} do
      armed(robot)
      assert call(robot, command(robot)) == {:ok, :accepted}
      assert_receive {:servo, :servo, :handle_command, %Message{payload: %Position{} = payload}}
      assert payload.position == 1.0
    end

    test "by call gets the driver's reply", %{robot: robot} do
      armed(robot)
      Servo.script(robot, :servo, handle_command: &{:reply, {:error, :stuck}, &1})
      assert call(robot, command(robot)) == {:error, :stuck}
      Servo.script(robot, :servo, handle_command: &{:reply, :done, &1, :hibernate})
      assert call(robot, command(robot)) == :done
      Servo.script(robot, :servo, handle_command: &{:noreply, &1, {:continue, :x}})
      assert call(robot, command(robot)) == {:ok, :accepted}
    end

    test "by cast and by topic is handled, and a reply is dropped", %{robot: robot} do
      armed(robot)
      Servo.script(robot, :servo, handle_command: &{:reply, :ignored, &1})
      BB.cast(robot, :servo, {:command, command(robot, Hold, [])})
      assert_receive {:servo, :servo, :handle_command, %{payload: %Hold{}}}
      BB.cast(robot, :servo, {:command, command(robot, Stop, []), nil})
      assert_receive {:servo, :servo, :handle_command, %{payload: %Stop{}}}
      BB.publish(robot, @topic, command(robot, Effort, effort: 4.0))
      assert_receive {:servo, :servo, :handle_command, %{payload: %Effort{effort: 2.0}}}
      settle(robot)
      refute_received {_ref, :ignored}
    end

    test "may stop the actuator, which comes back", %{robot: robot} do
      armed(robot)
      pid = BB.Process.whereis(robot, :servo)

      Servo.script(robot, :servo, handle_command: &{:stop, {:shutdown, :burnt}, &1})
      BB.cast(robot, :servo, {:command, command(robot)})

      assert eventually(fn -> BB.Process.whereis(robot, :servo) not in [pid, :undefined] end)
      assert [%{last_error: :burnt, restarts: 1} | _] = BB.Actuator.health(robot)
    end

    test "that is no message is not one by call, and the driver's own by cast", %{robot: robot} do
      armed(robot)
      assert BB.call(robot, :servo, {:command, :up}) == {:error, :not_a_command}
      BB.cast(robot, :servo, {:command, :up})
      assert_receive {:servo, :servo, :handle_cast, {:command, :up}}
    end

    test "is nothing else: other messages reach handle_info/2 untouched", %{robot: robot} do
      armed(robot)
      pid = BB.Process.whereis(robot, :servo)

      motion =
        Message.new!(BeginMotion, :elbow,
          initial_position: 0.0,
          target_position: 1.0,
          expected_arrival: 0
        )

      position = command(robot)

      for {path, message} <- [
            {@topic, motion},
            {[:actuator, :base, :elbow, :pusher], position},
            {[:sensor | @path], position}
          ] do
        send(pid, {:bb, path, message})
        assert_receive {:servo, :servo, :handle_info, {:bb, ^path, ^message}}
      end

      send(pid, :anything)
      assert_receive {:servo, :servo, :handle_info, :anything}
      refute_received {:servo, _, :handle_command, _}
    end

    test "of the actuator's own motion never comes back to it", %{robot: robot} do
      armed(robot)
      {:ok, _} = BB.subscribe(robot, [:actuator])

      :ok =
        BB.Actuator.publish_begin_motion(robot, @path,
          initial_position: 0.0,
          target_position: 2.0,
          expected_arrival: 7,
          peak_velocity: 3.0,
          command_type: :position
        )

      assert_receive {:bb, @topic, %{frame_id: :elbow, payload: %BeginMotion{} = motion}}
      assert {motion.initial_position, motion.target_position} == {1.0, 2.0}
      assert motion.peak_velocity == 1.5
      settle(robot)
      refute_received {:servo, :servo, :handle_info, _}
    end
  end

  describe "a refusal" do
    test "of an undeclared payload comes first", %{robot: robot} do
      start(robot)
      error = refused(robot, :pusher, command(robot, Hold, []))

      assert error == %UnsupportedCommand{
               robot: robot,
               actuator: :pusher,
               command: Hold,
               supported: [Position]
             }

      :ok = BB.Safety.arm(robot)
      assert refused(robot, :pusher, command(robot, Hold, [])) == error
    end

    test "while the robot is not armed holds for every command", %{robot: robot} do
      start(robot)

      for {payload, fields} <- [{Position, [position: 1.0]}, {Stop, []}, {Hold, []}] do
        assert refused(robot, :servo, command(robot, payload, fields)) ==
                 %NotArmed{robot: robot, actuator: :servo, command: payload}
      end

      :ok = BB.Safety.arm(robot)
      message = command(robot)
      :ok = BB.Safety.disarm(robot)
      assert %NotArmed{} = refused(robot, :servo, message)
    end

    test "of a command of no or an older arming", %{robot: robot} do
      armed(robot)
      {:ok, epoch} = BB.Safety.epoch(robot)
      old = command(robot)
      unstamped = %{old | arm_epoch: nil}
      fields = %{robot: robot, actuator: :servo, command: Position, current_epoch: epoch}

      assert refused(robot, :servo, unstamped) ==
               struct!(StaleEpoch, Map.put(fields, :epoch, nil))

      assert refused(robot, :servo, %{old | arm_epoch: epoch - 1}) ==
               struct!(StaleEpoch, Map.put(fields, :epoch, epoch - 1))

      :ok = BB.Safety.disarm(robot)
      :ok = BB.Safety.arm(robot)
      assert %StaleEpoch{epoch: ^epoch} = refused(robot, :servo, old)
      assert call(robot, command(robot)) == {:ok, :accepted}
    end

    test "is logged, and emitted with its transport", %{robot: robot} do
      start(robot)
      test = self()
      id = "#{inspect(robot)} rejected"

      BB.Telemetry.attach(
        id,
        [:bb, :actuator, :rejected],
        fn _event, measurements, metadata, robot ->
          if metadata.robot == robot, do: send(test, {:rejected, measurements, metadata})
        end,
        robot
      )

      on_exit(fn -> BB.Telemetry.detach(id) end)
      message = command(robot)

      log =
        capture_log(fn ->
          {:error, _} = call(robot, message)
          BB.cast(robot, :servo, {:command, message})
          BB.publish(robot, @topic, message)
          {:error, _} = call(robot, command(robot, Hold, []), :pusher)
        end)

      assert log =~ "refused"
      assert log =~ ":servo"
      assert log =~ "robot is not armed"

      for transport <- [:call, :cast, :pubsub] do
        assert_receive {:rejected, %{count: 1}, %{transport: ^transport} = metadata}

        if metadata.actuator == :servo do
          assert metadata == %{
                   robot: robot,
                   actuator: :servo,
                   transport: transport,
                   payload_module: Position,
                   reason: :disarmed
                 }
        end
      end

      assert_receive {:rejected, _, %{actuator: :pusher, reason: :unsupported_command}}
      :ok = BB.Safety.arm(robot)
      {:error, _} = call(robot, message)
      assert_receive {:rejected, _, %{reason: :stale_epoch}}
    end

    test "by cast with a process is sent to it, and nothing for an accepted command", %{
      robot: robot
    } do
      start(robot)
      id = make_ref()
      BB.cast(robot, :servo, {:command, command(robot), self()})
      assert_receive {:bb, :command_rejected, :servo, nil, %NotArmed{}}
      message = command(robot, Position, position: 1.0, command_id: id)
      BB.cast(robot, :servo, {:command, message, self()})
      assert_receive {:bb, :command_rejected, :servo, ^id, %NotArmed{}}
      :ok = BB.Safety.arm(robot)
      BB.cast(robot, :servo, {:command, command(robot), self()})
      assert_receive {:servo, :servo, :handle_command, _}
      refute_received {:bb, :command_rejected, _, _, _}
    end

    test "is held while commands, armings and disarmings race: no command of an old arming moves",
         %{robot: robot} do
      start(robot)
      test = self()

      Servo.script(robot, :servo,
        handle_command: fn state ->
          send(test, {:moved, BB.Safety.state(robot)})
          {:noreply, state}
        end
      )

      commander = spawn_link(fn -> command_forever(robot) end)

      for _ <- 1..20 do
        :ok = BB.Safety.arm(robot)
        assert_receive {:moved, _state}, 10_000
        :ok = BB.Safety.disarm(robot)
        settle(robot)
        flush_moved()
        settle(robot)
        refute_received {:moved, _state}
      end

      send(commander, :stop)
    end

    defp command_forever(robot) do
      _ = BB.Actuator.set_position(robot, :servo, 1.0)
      receive do: (:stop -> :ok), after: (1 -> command_forever(robot))
    end

    # The command that was checked just before the disarming.
    defp flush_moved do
      receive do
        {:moved, _state} -> flush_moved()
      after
        0 -> :ok
      end
    end

    defp refused(robot, name, message) do
      assert {:error, error} = call(robot, message, name)
      settle(robot, name)
      refute_received {:servo, ^name, :handle_command, _}
      error
    end
  end

  describe "sending by :pubsub, the default of set_position/4," do
    test "publishes for observers and calls the actuator, which takes it once", %{robot: robot} do
      armed(robot)
      {:ok, epoch} = BB.Safety.epoch(robot)
      {:ok, _} = BB.subscribe(robot, [:actuator])
      id = make_ref()
      opts = [velocity: 0.5, duration: 20, command_id: id]
      assert BB.Actuator.set_position(robot, :servo, 1, opts) == :ok

      payload = %Position{position: 1.0, velocity: 0.5, duration: 20, command_id: id}
      assert_receive {:bb, @topic, %{frame_id: :servo, payload: ^payload} = message}
      assert message.arm_epoch == epoch

      assert_receive {:servo, :servo, :handle_command, %{payload: %Position{position: +0.0}}}
      settle(robot)
      refute_received {:servo, :servo, :handle_command, _}
    end

    test "returns :ok for any reply but an error, and errors as they are", %{robot: robot} do
      armed(robot)

      for {reply, result} <- [{:done, :ok}, {{:ok, 7}, :ok}, {{:error, :hot}, {:error, :hot}}] do
        Servo.script(robot, :servo, handle_command: &{:reply, reply, &1})
        assert BB.Actuator.set_position(robot, @path, 1.0) == result
      end

      :ok = BB.Safety.disarm(robot)
      assert {:error, %NotArmed{}} = BB.Actuator.set_position(robot, :servo, 1.0)
    end

    test "exits when the actuator is late or absent", %{robot: robot} do
      armed(robot)
      Servo.script(robot, :servo, handle_command: fn _ -> Process.sleep(:infinity) end)

      assert {:timeout, _} = catch_exit(BB.Actuator.set_position(robot, :servo, 1.0, timeout: 1))

      Servo.script(robot, :servo, init: fn _ -> {:stop, :absent} end)
      Process.exit(BB.Process.whereis(robot, :servo), :kill)
      assert eventually(fn -> BB.Process.whereis(robot, :servo) == :undefined end)
      assert {:noproc, _} = catch_exit(BB.Actuator.set_position(robot, :servo, 1.0))
    end
  end

  describe "sending by :broadcast, the default of the others," do
    test "publishes, and the actuator receives it as a subscriber", %{robot: robot} do
      armed(robot)
      {:ok, _} = BB.subscribe(robot, [:actuator])
      assert BB.Actuator.set_velocity(robot, :servo, 2, duration: 5) == :ok
      assert_receive {:bb, @topic, %{payload: %Velocity{velocity: 2.0, duration: 5}}}
      assert_receive {:servo, _, :handle_command, %{payload: %Velocity{velocity: 4.0}}}

      assert BB.Actuator.set_effort(robot, @path, 2) == :ok
      assert_receive {:servo, _, :handle_command, %{payload: %Effort{effort: 1.0}}}

      assert BB.Actuator.stop(robot, :servo) == :ok
      assert_receive {:servo, _, :handle_command, %{payload: %Stop{mode: :immediate}}}
      assert BB.Actuator.stop(robot, :servo, mode: :decelerate) == :ok
      assert_receive {:servo, _, :handle_command, %{payload: %Stop{mode: :decelerate}}}

      id = make_ref()
      assert BB.Actuator.hold(robot, :servo, command_id: id) == :ok
      assert_receive {:servo, _, :handle_command, %{payload: %Hold{command_id: ^id}}}
    end

    test "takes waypoints as maps and keywords, and leaves absent rates out", %{robot: robot} do
      armed(robot)

      waypoints = [
        %{position: 1, time_from_start: 0},
        [position: 2.0, velocity: 1, acceleration: 3, time_from_start: 10]
      ]

      assert BB.Actuator.follow_trajectory(robot, :servo, waypoints, repeat: :forever) == :ok
      assert_receive {:servo, _, :handle_command, %{payload: %Trajectory{} = payload}}
      assert payload.repeat == :forever
      [first, second] = Enum.map(payload.waypoints, &Map.new/1)
      assert first == %{position: +0.0, velocity: nil, acceleration: nil, time_from_start: 0}
      assert second == %{position: 2.0, velocity: 2.0, acceleration: 6.0, time_from_start: 10}

      assert_raise ValidationError, ~r/position/, fn ->
        BB.Actuator.follow_trajectory(robot, :servo, [%{time_from_start: 0}])
      end
    end

    test "returns :ok also for a command that is refused, or that nobody hears", %{robot: robot} do
      start(robot)
      assert BB.Actuator.hold(robot, :servo) == :ok
      settle(robot)
      refute_received {:servo, _, :handle_command, _}
    end
  end

  describe "sending by :direct" do
    test "casts and publishes nothing", %{robot: robot} do
      armed(robot)
      {:ok, _} = BB.subscribe(robot, [:actuator])
      assert BB.Actuator.set_position(robot, :servo, 1.5, delivery: :direct) == :ok
      assert_receive {:servo, _, :handle_command, %{payload: %Position{position: 1.0}}}
      assert BB.Actuator.set_effort(robot, @path, 1.0, delivery: :direct) == :ok
      assert_receive {:servo, _, :handle_command, %{payload: %Effort{}}}
      refute_received {:bb, _, _}
    end

    test "looks no name up", %{robot: robot} do
      armed(robot)
      assert BB.Actuator.hold(robot, :nonexistent, delivery: :direct) == :ok
    end

    test "reports a refusal to the caller that asks for it", %{robot: robot} do
      start(robot)
      id = make_ref()
      opts = [delivery: :direct, reply_on_reject?: true, command_id: id]
      assert BB.Actuator.set_velocity(robot, :servo, 1.0, opts) == :ok
      assert_receive {:bb, :command_rejected, :servo, ^id, %NotArmed{command: Velocity}}
      assert BB.Actuator.hold(robot, :servo, delivery: :direct) == :ok
      settle(robot)
      refute_received {:bb, :command_rejected, _, _, _}
      :ok = BB.Safety.arm(robot)
      assert BB.Actuator.set_velocity(robot, :servo, 1.0, opts) == :ok
      assert_receive {:servo, _, :handle_command, _}
      refute_received {:bb, :command_rejected, _, _, _}
    end
  end

  describe "a mistake in a call" do
    test "reply_on_reject? without :direct says which delivery, and why", %{robot: robot} do
      error =
        assert_raise ValidationError, fn ->
          BB.Actuator.set_position(robot, :servo, 1.0, reply_on_reject?: true)
        end

      assert error.key == :reply_on_reject?
      message = Exception.message(error)

      for text <- ["reply_on_reject?", "delivery: :pubsub", "delivery: :direct"],
          do: assert(message =~ text)

      error =
        assert_raise ValidationError, fn ->
          BB.Actuator.hold(robot, :servo, reply_on_reject?: true)
        end

      message = Exception.message(error)
      assert message =~ "delivery: :broadcast"
      assert message =~ "every subscriber"
    end

    test "a wrong option is named, and a wrong value", %{robot: robot} do
      for {key, opts} <- [
            delivery: [delivery: :mail],
            timeout: [timeout: -1],
            command_id: [command_id: 7],
            velocity: [velocity: "fast"],
            duration: [duration: 0]
          ] do
        error =
          assert_raise ValidationError, fn ->
            BB.Actuator.set_position(robot, :servo, 1.0, opts)
          end

        assert error.key == key
      end

      assert_raise ValidationError, ~r/:speed/, fn ->
        BB.Actuator.stop(robot, :servo, speed: 1)
      end

      assert_raise FunctionClauseError, fn -> BB.Actuator.set_position(robot, :servo, "far") end
    end

    test "an unknown name says which names there are", %{robot: robot} do
      for name <- [:nonexistent, :encoder], delivery <- [:pubsub, :broadcast] do
        error =
          assert_raise ArgumentError, fn ->
            BB.Actuator.hold(robot, name, delivery: delivery)
          end

        assert Exception.message(error) =~ "has no actuator named #{inspect(name)}"
        assert Exception.message(error) =~ "[:pusher, :servo]"
      end
    end
  end

  test "set_position_sync/3,4,5 returns the raw answer, and publishes nothing", %{robot: robot} do
    start(robot)
    {:ok, _} = BB.subscribe(robot, [:actuator])
    assert {:error, %NotArmed{}} = BB.Actuator.set_position_sync(robot, :servo, 1.0)
    :ok = BB.Safety.arm(robot)
    assert BB.Actuator.set_position_sync(robot, :servo, 1.0) == {:ok, :accepted}
    Servo.script(robot, :servo, handle_command: &{:reply, :done, &1})
    assert BB.Actuator.set_position_sync(robot, @path, 1, [velocity: 1.0], 1_000) == :done
    refute_received {:bb, _, _}
  end

  test "to_joint_space/3 converts what a driver reports", %{robot: robot} do
    message =
      Message.new!(BB.Message.Sensor.JointState, :elbow, names: [:elbow], positions: [2.0])

    converted = BB.Actuator.to_joint_space(robot, @path, message)
    assert converted.payload.positions == [2.0]
    assert %{converted | payload: message.payload} == message

    again = BB.Actuator.to_joint_space(robot, [:base, :elbow, :pusher], message)
    assert again == message
    assert BB.Actuator.to_joint_space(NoRobot, @path, message) == message
  end

  test "a killed actuator takes commands again when it is back", %{robot: robot} do
    armed(robot)

    for _ <- 1..5 do
      pid = BB.Process.whereis(robot, :servo)
      Process.exit(pid, :kill)
      assert eventually(fn -> BB.Process.whereis(robot, :servo) not in [pid, :undefined] end)
      assert await_all_up(robot)
      new = BB.Process.whereis(robot, :servo)
      assert eventually(fn -> match?([{^new, _}], BB.PubSub.subscribers(robot, @topic)) end)
      assert BB.Actuator.hold(robot, :servo) == :ok
      assert_receive {:servo, :servo, :handle_command, %{payload: %Hold{}}}
    end
  end
end
