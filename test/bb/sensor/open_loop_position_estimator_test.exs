defmodule BB.Sensor.OpenLoopPositionEstimatorTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
  import BB.Unit

  alias BB.Message
  alias BB.Message.Actuator.BeginMotion
  alias BB.Message.Sensor.JointState
  alias BB.Sensor.OpenLoopPositionEstimator, as: Estimator

  @path [:base, :elbow, :position]
  @topic [:sensor | @path]

  defp now, do: System.monotonic_time(:millisecond)

  defp motion(fields) do
    fields = Keyword.merge([initial_position: 0.0, target_position: 1.0], fields)
    Message.new!(BeginMotion, :elbow, fields)
  end

  describe "its callbacks" do
    setup do
      robot = Module.concat(__MODULE__, "R#{System.unique_integer([:positive])}")
      start_supervised!({BB.PubSub, robot})
      {:ok, _} = BB.subscribe(robot, [:sensor])
      %{robot: robot, bb: %{robot: robot, path: @path}}
    end

    defp init(bb, opts \\ []) do
      {:ok, state, timeout} = Estimator.init([bb: bb, actuator: :servo] ++ opts)
      assert timeout == state.max_silence_ms
      state
    end

    defp info(message, state) do
      {:noreply, new, timeout} = Estimator.handle_info(message, state)
      assert timeout == state.max_silence_ms
      new
    end

    test "init/1 subscribes, and fills in the defaults", %{robot: robot, bb: bb} do
      state = init(bb)

      assert %{
               actuator: :servo,
               actuator_path: [:actuator, :base, :elbow, :servo],
               easing: :linear,
               publish_interval_ms: 20,
               max_silence_ms: 5_000,
               joint_name: :elbow,
               name: :position,
               initial_position: nil,
               target_position: nil,
               expected_arrival: nil,
               command_time: nil,
               acceleration: nil,
               peak_velocity: nil,
               last_published: nil,
               tick_ref: nil
             } = state

      assert [{pid, [BeginMotion]}] = BB.PubSub.subscribers(robot, state.actuator_path)
      assert pid == self()
      opts = [publish_rate: ~u(0.2 kilohertz), max_silence: ~u(100 millisecond)]
      assert %{publish_interval_ms: 5, max_silence_ms: 100} = init(bb, opts)
    end

    test "a motion that is over is published at once", %{bb: bb} do
      state = info(motion(expected_arrival: now() - 1), init(bb))
      assert_received {:bb, @topic, %{frame_id: :position, payload: payload}}
      assert payload == %JointState{names: [:elbow], positions: [1.0]}
      assert %{last_published: 1.0, tick_ref: nil} = state
    end

    test "a motion ticks after each interval until it is over", %{bb: bb} do
      arrival = now() + 3_600_000
      message = motion(expected_arrival: arrival, acceleration: 2.0, peak_velocity: 3.0)
      state = info({:bb, [:actuator, :base, :elbow, :servo], message}, init(bb))

      assert %{
               initial_position: +0.0,
               target_position: 1.0,
               expected_arrival: ^arrival,
               acceleration: 2.0,
               peak_velocity: 3.0,
               last_published: nil
             } = state

      assert_in_delta state.command_time, now(), 60_000
      assert is_integer(Process.read_timer(state.tick_ref))
      assert_receive :tick
      state = info(:tick, %{state | command_time: arrival - 7_200_000, acceleration: nil})
      assert_received {:bb, @topic, %{payload: %{positions: [position]}}}
      assert_in_delta position, 0.5, 0.01
      assert state.last_published == position
      assert_receive :tick

      state = info(:tick, %{state | expected_arrival: now()})
      assert_received {:bb, @topic, %{payload: %{positions: [1.0]}}}
      assert state.tick_ref == nil
    end

    test "a tick publishes no position twice", %{bb: bb} do
      state = info(motion(target_position: 0.0, expected_arrival: now() + 3_600_000), init(bb))
      state = info(:tick, %{state | last_published: 0.0})
      refute_received {:bb, @topic, _}
      assert is_reference(state.tick_ref)
    end

    test "a new motion replaces the running one, and its ticks", %{bb: bb} do
      first = info(motion(expected_arrival: now() + 3_600_000), init(bb))
      assert eventually(fn -> Process.read_timer(first.tick_ref) == false end)
      second = info(motion(target_position: 2.0, expected_arrival: now() + 3_600_000), first)
      assert second.target_position == 2.0
      assert second.tick_ref != first.tick_ref
      assert_receive :tick
      refute_received :tick
    end

    test "a time-out repeats the present position once there was a motion", %{bb: bb} do
      state = init(bb)
      assert info(:timeout, state) == state
      refute_received {:bb, @topic, _}
      state = info(motion(expected_arrival: now()), state)
      assert_received {:bb, @topic, _}
      info(:timeout, state)
      assert_received {:bb, @topic, %{payload: %{positions: [1.0]}}}
    end

    test "other messages change nothing", %{bb: bb} do
      state = init(bb)
      other = Message.new!(JointState, :elbow, names: [:elbow], positions: [1.0])

      for message <- [other, {:bb, @topic, other}, :anything, :tick],
          do: assert(info(message, state) == state)

      assert Estimator.handle_cast(:x, state) == {:noreply, state, 5_000}
      refute_received {:bb, @topic, _}
    end
  end

  test "in a robot it reports the way of its actuator, to the end and from then on" do
    robot =
      robot do
        topology do
          link :base do
            joint :elbow do
              type :continuous

              actuator :servo, BB.Test.Motor do
                transmission reduction: 2.0
              end

              sensor :position,
                     {BB.Sensor.OpenLoopPositionEstimator,
                      actuator: :servo,
                      easing: :ease_in_out_quad,
                      publish_rate: ~u(200 hertz),
                      max_silence: ~u(20 millisecond)}

              link :arm
            end
          end
        end
      end

    start_supervised!(robot)
    assert await_all_up(robot)
    {:ok, _} = BB.subscribe(robot, [:sensor])

    BB.Actuator.publish_begin_motion(robot, [:base, :elbow, :servo],
      initial_position: 0.0,
      target_position: 4.0,
      expected_arrival: now() + 50
    )

    positions = positions_until(2.0)
    assert positions == Enum.sort(positions)
    assert Enum.uniq(positions) == positions
    assert_receive {:bb, @topic, %{payload: %{positions: [2.0]}}}, 10_000
    assert eventually(fn -> BB.Robot.Runtime.configurations(robot).elbow == 2.0 end)

    pid = BB.Process.whereis(robot, :position)
    Process.exit(pid, :kill)
    assert eventually(fn -> BB.Process.whereis(robot, :position) not in [pid, :undefined] end)
    assert await_all_up(robot)

    BB.Actuator.publish_begin_motion(robot, [:base, :elbow, :servo],
      initial_position: 4.0,
      target_position: -2.0,
      expected_arrival: now()
    )

    assert_receive {:bb, @topic, %{payload: %{positions: [-1.0]}}}, 10_000
  end

  defp positions_until(last) do
    assert_receive {:bb, @topic, %{payload: %{positions: [position]}}}, 10_000
    if position == last, do: [position], else: [position | positions_until(last)]
  end
end
