defmodule BBTest do
  use ExUnit.Case, async: true

  import BB.Test.Robot, only: [robot: 1]

  alias BB.Message.Sensor.Range
  alias BB.Test.Probe

  setup do
    robot =
      robot do
        sensors do
          sensor :sonar, BB.Test.Probe
        end
      end

    %{robot: robot}
  end

  defp range do
    BB.Message.new!(Range, :sonar,
      radiation_type: :ultrasound,
      field_of_view: 0.3,
      min_range: 0.02,
      max_range: 4.0,
      range: 1.0
    )
  end

  describe "use BB" do
    test "defines robot/0, start_link/0,1 and child_spec/0,1", %{robot: robot} do
      assert %BB.Robot{name: ^robot} = robot.robot()
      assert function_exported?(robot, :start_link, 0)
      assert function_exported?(robot, :start_link, 1)
      spec = %{id: robot, start: {robot, :start_link, [[]]}, type: :supervisor}
      assert robot.child_spec() == spec
      assert robot.child_spec([]) == spec
      assert robot.child_spec(a: 1) == %{spec | start: {robot, :start_link, [[a: 1]]}}
    end

    test "takes an empty list of extensions, and refuses others" do
      for {options, number} <-
            Enum.with_index(["", ", extensions: []", ", extensions: [], fragments: []"]) do
        assert [{robot, _}] =
                 Code.compile_string("defmodule BBTest.Extended#{number} do use BB#{options} end")

        assert %BB.Robot{name: ^robot} = robot.robot()
      end

      for options <- ["extensions: [My.Extension]", "otp: :my_robot", ":extensions"] do
        error =
          assert_raise BB.Dsl.Error, fn ->
            Code.compile_string(
              "defmodule BBTest.Refused do\nuse BB, #{options}\nend",
              "robot.ex"
            )
          end

        assert Exception.message(error) =~
                 ~r/^BBTest.Refused \(robot.ex:2\): cannot extend the DSL: /

        assert Exception.message(error) =~ options
      end
    end

    test "makes start_link/0 start the robot under its name", %{robot: robot} do
      assert {:ok, pid} = robot.start_link()
      assert Process.whereis(robot) == pid
      Supervisor.stop(pid)
    end
  end

  describe "the facade" do
    setup %{robot: robot} do
      start_supervised!(robot)
      :ok
    end

    test "subscribes, publishes and unsubscribes", %{robot: robot} do
      assert {:ok, _} = BB.subscribe(robot, [:sensor], message_types: [Range])
      assert BB.publish(robot, [:sensor, :sonar], range()) == :ok
      assert_receive {:bb, [:sensor, :sonar], %BB.Message{robot: ^robot, payload: %Range{}}}
      assert BB.publish(robot, [:sensor, :sonar], range(), except: [self()]) == :ok
      refute_received {:bb, _, _}
      assert BB.unsubscribe(robot, [:sensor]) == :ok
      BB.publish(robot, [:sensor, :sonar], range())
      refute_received {:bb, _, _}
    end

    test "calls, casts and sends by name", %{robot: robot} do
      test = self()

      Probe.script(robot, :sonar,
        handle_call: fn request, _from, s -> {:reply, {:called, request}, s} end,
        handle_cast: fn request, s ->
          send(test, {:cast, request})
          {:noreply, s}
        end,
        handle_info: fn message, s ->
          send(test, {:sent, message})
          {:noreply, s}
        end
      )

      assert BB.call(robot, :sonar, 1) == {:called, 1}
      assert BB.call(robot, :sonar, 2, 1_000) == {:called, 2}
      assert BB.cast(robot, :sonar, 3) == :ok
      assert_receive {:cast, 3}
      assert BB.send(robot, :sonar, 4) == :ok
      assert_receive {:sent, 4}
    end

    test "tells a caller when nobody of that name is there; casts and sends are lost", %{
      robot: robot
    } do
      assert {:noproc, _} = catch_exit(BB.call(robot, :nobody, 1))
      assert BB.cast(robot, :nobody, 1) == :ok
      assert BB.send(robot, :nobody, 1) == :ok
    end
  end
end
