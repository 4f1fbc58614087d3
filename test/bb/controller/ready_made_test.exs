defmodule BB.Controller.ReadyMadeTest do
  @moduledoc "The ready-made controllers: `PatternMatch` and `Threshold`."

  use ExUnit.Case, async: true

  import BB.Controller.Action
  import BB.Test.Robot

  alias BB.Controller.{Action, PatternMatch, Threshold}
  alias BB.Message
  alias BB.Message.Sensor.{Imu, PowerState}

  doctest Action

  defmodule Events do
    @moduledoc "Sends what it is called with to the process with the robot's name and `Test`."
    def tell(message, context) do
      send(Module.concat(context.robot_module, Test), {:event, message, context})
    end

    def low?(%{payload: %PowerState{voltage: voltage}}), do: voltage < 9.0
    def low?(_message), do: false
  end

  defp power(voltage), do: Message.new!(PowerState, :battery, voltage: voltage, current: 0.0)

  defp state(opts, last \\ :never) do
    bb = %{robot: __MODULE__.Alone, path: [:watch]}
    %{opts: [bb: bb] ++ opts, last_triggered: last}
  end

  defmodule Alone do
    @moduledoc "A robot that does not run, with a command."
    def robot, do: %BB.Robot{name: __MODULE__}

    def halt(goal) do
      send(self(), {:halt, goal})
      {:ok, self()}
    end
  end

  test "handle_event/1 and command/1,2 are plain data, which execute/3 carries out" do
    assert command(:halt) == %Action.Command{command: :halt, args: []}
    assert command(:halt, hard: true) == %Action.Command{command: :halt, args: [hard: true]}
    fun = &Events.tell/2
    assert handle_event(fun) == %Action.Callback{handler: fun}
    context = %Action.Context{robot_module: Alone}
    assert {:ok, _} = Action.execute(command(:halt, hard: true), power(1.0), context)
    assert_received {:halt, %{hard: true}}
    assert Action.execute(handle_event(fn m, c -> {m, c} end), 1, context) == {1, context}
    assert_raise FunctionClauseError, fn -> handle_event(fn -> :no end) end
  end

  describe "PatternMatch" do
    test "acts on a message that matches, with the context of the robot" do
      test = self()
      action = handle_event(&send(test, {:event, &1, &2}))
      state = state(match: &Events.low?/1, action: action, cooldown_ms: 0)
      message = power(8.0)
      assert {:noreply, new} = PatternMatch.handle_info({:bb, [:sensor, :b], message}, state)
      assert is_integer(new.last_triggered)
      assert new.opts == state.opts
      assert_received {:event, ^message, context}

      assert context == %Action.Context{
               robot_module: Alone,
               robot: Alone.robot(),
               robot_state: :disarmed,
               controller_name: :watch
             }
    end

    test "ignores what does not match, and what is no message" do
      test = self()
      action = handle_event(fn _, _ -> send(test, :acted) end)
      state = state(match: &Events.low?/1, action: action)

      for info <- [{:bb, [:sensor], power(10.0)}, :tick, {:bb, [:sensor], :no_message}],
          do: assert(PatternMatch.handle_info(info, state) == {:noreply, state})

      refute_received :acted
    end

    test "acts again when its cooldown is over, 1000 ms by default" do
      now = System.monotonic_time(:millisecond)
      opts = [match: fn _ -> true end, action: command(:halt)]
      info = {:bb, [:sensor], power(1.0)}

      resting = state(opts, now)
      assert PatternMatch.handle_info(info, resting) == {:noreply, resting}
      refute_received {:halt, _}

      assert {:noreply, %{last_triggered: last}} =
               PatternMatch.handle_info(info, state(opts, now - 1_000))

      assert last >= now
      assert_received {:halt, %{}}
      PatternMatch.handle_info(info, state([cooldown_ms: 0] ++ opts, now))
      assert_received {:halt, _}
    end
  end

  describe "Threshold" do
    setup do
      start_supervised!({BB.PubSub, Alone})
      :ok
    end

    defp acts?(opts, message) do
      bb = %{robot: Alone, path: [:watch]}
      options = [bb: bb, topic: [:sensor], action: command(:halt), cooldown_ms: 0] ++ opts
      {:ok, state} = Threshold.init(options)
      assert is_function(state.opts[:match], 1)
      assert state.last_triggered == :never
      {:noreply, new} = Threshold.handle_info({:bb, [:sensor], message}, state)
      new.last_triggered != :never
    end

    test "acts below min and above max, and at neither bound" do
      assert acts?([field: :voltage, min: 9.0], power(8.9))
      refute acts?([field: :voltage, min: 9.0], power(9.0))
      assert acts?([field: :voltage, max: 12.0], power(12.1))
      refute acts?([field: :voltage, max: 12.0], power(12.0))
      refute acts?([field: :voltage, min: 9.0, max: 12.0], power(10.0))
      assert acts?([field: [:voltage], min: 9.0, max: 12.0], power(20.0))
    end

    test "finds nested fields, and never acts for one that is nil or absent" do
      imu =
        Message.new!(Imu, :imu,
          orientation: BB.Math.Quaternion.identity(),
          angular_velocity: BB.Math.Vec3.new(0, 0, 5),
          linear_acceleration: BB.Math.Vec3.zero()
        )

      assert acts?([field: [:angular_velocity, :z], max: 4.0], imu)
      refute acts?([field: [:angular_velocity, :x], max: 4.0], imu)

      for field <- [:nothing, [:angular_velocity, :nothing], [:angular_velocity, :z, :deeper]],
          do: refute(acts?([field: field, min: 100.0], imu))
    end

    test "needs a bound" do
      bb = %{robot: Alone, path: [:watch]}

      assert_raise ArgumentError, ~r/:min or :max/, fn ->
        Threshold.init(bb: bb, topic: [:sensor], field: :voltage, action: command(:halt))
      end
    end
  end

  test "both are declared with the words of actions, and act on what sensors publish" do
    robot =
      robot do
        parameters do
          param :least, type: :float, default: 9.0
        end

        sensors do
          sensor :battery, BB.Test.Probe
        end

        controllers do
          controller :pattern,
                     {BB.Controller.PatternMatch,
                      topic: [:sensor],
                      match: &BB.Controller.ReadyMadeTest.Events.low?/1,
                      action: handle_event(&BB.Controller.ReadyMadeTest.Events.tell/2),
                      cooldown_ms: 0}

          controller :threshold,
                     {BB.Controller.Threshold,
                      topic: [:sensor, :battery],
                      field: :voltage,
                      min: param([:least]),
                      action: command(:halt, soft: true),
                      cooldown_ms: 0}
        end

        def halt(goal), do: send(Module.concat(__MODULE__, Test), {:halt, goal})
      end

    Process.register(self(), Module.concat(robot, Test))
    start_supervised!(robot)
    assert await_all_up(robot)
    :ok = BB.Safety.arm(robot)
    BB.publish(robot, [:sensor, :battery], power(8.0))
    assert_receive {:event, %{payload: %PowerState{voltage: 8.0}}, context}
    assert %{robot_module: ^robot, controller_name: :pattern, robot_state: :idle} = context
    assert context.robot == robot.robot()
    assert_receive {:halt, %{soft: true}}

    BB.publish(robot, [:sensor, :battery], power(10.0))
    :ok = BB.Parameter.set(robot, [:least], 11.0)
    _ = BB.call(robot, :threshold, :settle)
    BB.publish(robot, [:sensor, :battery], power(10.0))
    assert_receive {:halt, _}
    _ = BB.call(robot, :threshold, :settle)
    refute_received {:halt, _}
  end
end
