defmodule BB.Sensor.MimicTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Message
  alias BB.Message.Sensor.{JointState, PowerState}

  setup do
    robot =
      robot do
        parameters do
          param :coupling, type: :float, default: 2.0
        end

        topology do
          link :base do
            joint :left do
              type :continuous
              sensor :encoder, BB.Test.Probe
              sensor :spare, BB.Test.Probe

              link :left_finger do
                sensor :pad, BB.Test.Probe

                joint :knuckle do
                  type :continuous
                  sensor :knuckle_encoder, BB.Test.Probe
                  link :left_tip
                end
              end
            end

            joint :right do
              type :continuous

              sensor :mirror,
                     {BB.Sensor.Mimic, source: :left, multiplier: param([:coupling]), offset: 0.5}

              sensor :by_name, {BB.Sensor.Mimic, source: :encoder}

              sensor :by_path,
                     {BB.Sensor.Mimic,
                      source: [:base, :left, :encoder],
                      message_types: [BB.Message.Sensor.JointState, BB.Message.Sensor.PowerState]}

              sensor :power,
                     {BB.Sensor.Mimic,
                      source: :left, message_types: [BB.Message.Sensor.PowerState]}

              link :right_finger
            end
          end
        end
      end

    %{robot: robot}
  end

  @source [:base, :left, :encoder]
  @mirror [:sensor, :base, :right, :mirror]
  @by_name [:sensor, :base, :right, :by_name]
  @by_path [:sensor, :base, :right, :by_path]
  @power [:sensor, :base, :right, :power]

  defp start(robot) do
    start_supervised!(robot)
    assert BB.Test.Robot.await_all_up(robot)
    {:ok, _} = BB.subscribe(robot, [:sensor, :base, :right])
    robot
  end

  defp publish(robot, fields, path \\ @source) do
    message = Message.new!(JointState, :left, Keyword.put_new(fields, :names, [:left]))
    BB.publish(robot, [:sensor | path], message)
    %{message | robot: robot}
  end

  # Returns when the mimic has handled all messages that were sent to it before.
  defp settle(robot, name), do: {:error, :not_implemented} = BB.call(robot, name, :settle)

  test "is the other joint's state for its own: positions and velocities are scaled", %{
    robot: robot
  } do
    start(robot)
    message = publish(robot, positions: [1.0], velocities: [0.25], efforts: [3.0])
    assert_receive {:bb, @mirror, mimicked}

    payload = %JointState{names: [:right], positions: [2.5], velocities: [0.5], efforts: [3.0]}
    assert mimicked == %{message | payload: payload}
  end

  test "follows every sensor of the joint, and none of the joints beyond it", %{robot: robot} do
    start(robot)
    publish(robot, [positions: [1.0]], [:base, :left, :spare])
    assert_receive {:bb, @mirror, %{payload: %{positions: [2.5]}}}
    publish(robot, [positions: [9.0]], [:base, :left, :left_finger, :knuckle, :knuckle_encoder])
    settle(robot, :mirror)
    refute_received {:bb, @mirror, _}
  end

  test "of several joints of one message each counts, under the own name", %{robot: robot} do
    start(robot)
    publish(robot, names: [:other, :left], positions: [9.0, 1.0])
    assert_receive {:bb, @mirror, %{payload: payload}}
    assert payload == %JointState{names: [:right, :right], positions: [18.5, 2.5]}
  end

  test "multiplier is 1.0, offset 0.0, and the source may be a sensor, by name or path", %{
    robot: robot
  } do
    start(robot)
    publish(robot, positions: [1.0])

    for path <- [@by_name, @by_path] do
      assert_receive {:bb, ^path, %{frame_id: :left, payload: state}}
      assert state == %JointState{names: [:right], positions: [1.0]}
    end

    publish(robot, [positions: [1.0]], [:base, :left, :spare])
    settle(robot, :by_name)
    refute_received {:bb, @by_name, _}
  end

  test "of several joints of a sensor the one counts that is its frame_id", %{robot: robot} do
    start(robot)
    publish(robot, names: [:other, :left], positions: [9.0, 1.0], efforts: [5.0])
    assert_receive {:bb, @by_path, %{payload: payload}}
    assert payload == %JointState{names: [:right], positions: [1.0], efforts: []}
  end

  test "payloads of other types are published unchanged, of `message_types` alone", %{
    robot: robot
  } do
    start(robot)
    power = Message.new!(PowerState, :x, voltage: 7.0, current: 1.0)
    expected = %{power | robot: robot}
    BB.publish(robot, [:sensor | @source], power)
    publish(robot, positions: [1.0])
    assert_receive {:bb, @by_path, ^expected}
    assert_receive {:bb, @power, ^expected}
    assert_receive {:bb, @mirror, %{payload: %JointState{}}}
    refute_received {:bb, @mirror, %{payload: %PowerState{}}}
    BB.publish(robot, [:sensor, :base, :left, :left_finger, :pad], power)
    assert_receive {:bb, @power, ^expected}
    settle(robot, :power)
    refute_received {:bb, @power, %{payload: %JointState{}}}
  end

  test "follows parameters, and publishes each message once after a change", %{robot: robot} do
    start(robot)
    :ok = BB.Parameter.set(robot, [:coupling], -1.0)
    settle(robot, :mirror)
    publish(robot, positions: [1.0])
    assert_receive {:bb, @mirror, %{payload: %{positions: [-0.5]}}}
    settle(robot, :mirror)
    refute_received {:bb, @mirror, _}
  end

  test "of an unknown source is down, and names it" do
    robot =
      robot do
        sensors do
          sensor :mirror, {BB.Sensor.Mimic, source: :nobody}
        end
      end

    start_supervised!(robot)
    assert eventually(fn -> health(robot, :mirror).state == :backoff end)

    assert BB.Sensor.explain(BB.Sensor.Mimic, health(robot, :mirror).reason) ==
             "the robot has no joint and no sensor :nobody: correct `source:`"
  end

  test "init/1 alone fills in the defaults, without a robot" do
    robot = Module.concat(__MODULE__, "Alone#{System.unique_integer([:positive])}")
    start_supervised!({BB.PubSub, robot})
    bb = %{robot: robot, path: [:base, :right, :mirror]}
    assert {:ok, state} = BB.Sensor.Mimic.init(bb: bb, source: :left)

    assert %{
             bb: ^bb,
             multiplier: 1.0,
             offset: +0.0,
             source: :left,
             joint_name: :right,
             sensor_name: :mirror,
             source_path: [:sensor, :base, :left],
             message_types: [JointState]
           } = state

    assert [{_, [JointState]}] = BB.PubSub.subscribers(robot, [:sensor, :base, :left])
    {:ok, _} = BB.subscribe(robot, [:sensor, :base, :right])
    message = Message.new!(JointState, :left, names: [:left], positions: [2.0])
    path = [:sensor, :base, :left, :encoder]
    assert {:noreply, ^state} = BB.Sensor.Mimic.handle_info({:bb, path, message}, state)
    assert_receive {:bb, @mirror, %{frame_id: :left, payload: %{positions: [2.0]}}}
    assert {:noreply, ^state} = BB.Sensor.Mimic.handle_info(:else, state)
  end

  test "a killed source, and a killed mimic, lose no later message", %{robot: robot} do
    start(robot)

    for name <- [:encoder, :mirror] do
      pid = BB.Process.whereis(robot, name)
      Process.exit(pid, :kill)
      assert eventually(fn -> BB.Process.whereis(robot, name) not in [pid, :undefined] end)
      assert BB.Test.Robot.await_all_up(robot)
      publish(robot, positions: [1.0])
      assert_receive {:bb, @mirror, %{payload: %{positions: [2.5]}}}
    end
  end
end
