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
              link :left_finger
            end

            joint :right do
              type :continuous

              sensor :mirror,
                     {BB.Sensor.Mimic,
                      source: :encoder, multiplier: param([:coupling]), offset: 0.5}

              sensor :by_path,
                     {BB.Sensor.Mimic,
                      source: [:base, :left, :encoder],
                      message_types: [BB.Message.Sensor.JointState, BB.Message.Sensor.PowerState]}

              link :right_finger
            end
          end
        end
      end

    %{robot: robot}
  end

  @source [:base, :left, :encoder]
  @mirror [:sensor, :base, :right, :mirror]
  @by_path [:sensor, :base, :right, :by_path]

  defp start(robot) do
    start_supervised!(robot)
    assert BB.Test.Robot.await_all_up(robot)
    {:ok, _} = BB.subscribe(robot, [:sensor, :base, :right])
    robot
  end

  defp publish(robot, fields) do
    message = Message.new!(JointState, :left, Keyword.put_new(fields, :names, [:left]))
    BB.publish(robot, [:sensor | @source], message)
    message
  end

  test "is another sensor's joint state for a coupled joint: positions and velocities are scaled",
       %{robot: robot} do
    start(robot)
    message = publish(robot, positions: [1.0], velocities: [0.25], efforts: [3.0])

    assert_receive {:bb, @mirror, %Message{frame_id: :right, payload: state} = mimicked}
    assert state == %JointState{names: [:right], positions: [2.5], velocities: [0.5], efforts: []}
    assert mimicked.monotonic_time == message.monotonic_time
  end

  test "multiplier is 1.0, offset 0.0, and the source may be a path", %{robot: robot} do
    start(robot)
    publish(robot, positions: [1.0])
    assert_receive {:bb, @by_path, %{payload: state}}
    assert state == %JointState{names: [:right], positions: [1.0]}
  end

  test "of several joints the source's own counts", %{robot: robot} do
    start(robot)
    publish(robot, names: [:other, :left], positions: [9.0, 1.0])
    assert_receive {:bb, @by_path, %{payload: %{positions: [1.0]}}}
  end

  test "message_types are taken over, others are not", %{robot: robot} do
    start(robot)
    power = Message.new!(PowerState, :x, voltage: 7.0, current: 1.0)
    BB.publish(robot, [:sensor | @source], power)
    publish(robot, positions: [1.0])
    assert_receive {:bb, @by_path, %{frame_id: :right, payload: %PowerState{voltage: 7.0}}}
    assert_receive {:bb, @mirror, %{payload: %JointState{}}}
    refute_received {:bb, @mirror, %{payload: %PowerState{}}}
  end

  test "follows parameters, and publishes each message once after a change", %{robot: robot} do
    start(robot)
    :ok = BB.Parameter.set(robot, [:coupling], -1.0)
    _ = BB.call(robot, :mirror, :settled)
    publish(robot, positions: [1.0])
    assert_receive {:bb, @mirror, %{payload: %{positions: [-0.5]}}}
    _ = BB.call(robot, :mirror, :settled)
    refute_received {:bb, @mirror, _}
  end

  test "of an unknown sensor is down, and names it" do
    robot =
      robot do
        sensors do
          sensor :mirror, {BB.Sensor.Mimic, source: :nobody}
        end
      end

    start_supervised!(robot)
    assert eventually(fn -> health(robot, :mirror).state == :backoff end)

    assert BB.Sensor.explain(BB.Sensor.Mimic, health(robot, :mirror).reason) ==
             "the robot has no sensor :nobody: correct `source:`"
  end
end
