defmodule PackagesTest do
  @moduledoc """
  Runs drivers on a robot that are written as the packages for Beam Bots are
  (`BB.Test.Packages`).
  """

  # Code that captures the compiler's warnings, which every process shares.
  use ExUnit.Case, async: false

  import BB.Test.Eventually
  import ExUnit.CaptureIO
  import BB.Test.Robot, only: [robot: 1]

  alias BB.Math.{Quaternion, Vec3}
  alias BB.Message
  alias BB.Message.Actuator.{BeginMotion, Command}
  alias BB.Message.Sensor.{Imu, JointState, PowerState}
  alias BB.Options.ValidationError
  alias BB.Test.{Packages, Source}

  setup_all do
    for package <- ~w(power_monitor sampled_imu attitude pid_controller servo_board),
        do: Packages.compile!(package)

    :ok
  end

  # The drivers are compiled by the tests.
  defp module(name), do: Module.concat([name])

  defp start(robot) do
    start_supervised!(robot)
    robot
  end

  defp up?(kind, robot, name), do: row(kind, robot, name).state == :up

  defp row(kind, robot, name), do: robot |> kind.health() |> Enum.find(&(&1.name == name))

  defp ticks(robot, name), do: user_state(robot, name).loop.ticks

  defp user_state(robot, name),
    do: :sys.get_state(BB.Process.whereis(robot, name)).user_state

  describe "a sensor with quantities as options" do
    setup do
      robot =
        robot do
          parameters do
            param :rate, type: {:unit, :hertz}, default: ~u(100 hertz)
          end

          topology do
            link :base_link do
              sensor :battery, {PowerMonitor.Sensor, bus: "i2c-1", publish_rate: param([:rate])}

              sensor :motors,
                     {PowerMonitor.Sensor, bus: "i2c-1", address: 0x41, shunt: ~u(20 milliohm)}
            end
          end
        end

      %{robot: robot}
    end

    test "publishes, with the quantities of its options converted", %{robot: robot} do
      start(robot)
      {:ok, _} = BB.subscribe(robot, [:sensor], message_types: [PowerState])
      assert_receive {:bb, [:sensor, :base_link, :battery], %Message{} = battery}, 60_000
      assert_receive {:bb, [:sensor, :base_link, :motors], %Message{} = motors}, 60_000
      assert %{frame_id: :battery, payload: %{voltage: 7.4, current: current}} = battery
      assert_in_delta current, 0.2, 1.0e-12
      assert_in_delta motors.payload.current, 1.0, 1.0e-12
      assert user_state(robot, :battery).loop.clock == {:rate, 100.0}
      assert user_state(robot, :motors).loop.clock == {:rate, 10.0}
    end

    test "follows the parameter of its rate", %{robot: robot} do
      start(robot)
      assert eventually(fn -> up?(BB.Sensor, robot, :battery) end)
      :ok = BB.Parameter.set(robot, [:rate], BB.Unit.new!(0.05, "kilohertz"))
      assert eventually(fn -> user_state(robot, :battery).loop.clock == {:rate, 50.0} end)
      assert eventually(fn -> ticks(robot, :battery) > 2 end)
    end

    test "refuses a quantity of another kind: a warning, and the robot does not start" do
      {robot, warning} =
        with_io(:stderr, fn ->
          robot do
            topology do
              link :base_link do
                sensor :battery,
                       {PowerMonitor.Sensor, bus: "i2c-1", publish_rate: ~u(10 meter)}
              end
            end
          end
        end)

      assert warning =~ "The unit `meter` is not compatible with `hertz`"
      assert {:error, %ValidationError{key: :publish_rate}} = robot.start_link()
    end

    test "that has no chip is down alone, with its reason" do
      robot =
        robot do
          topology do
            link :base_link do
              sensor :absent, {PowerMonitor.Sensor, bus: "absent"}
              sensor :battery, {PowerMonitor.Sensor, bus: "i2c-1"}
            end
          end
        end

      start(robot)
      assert eventually(fn -> row(BB.Sensor, robot, :absent).last_error == :no_answer end)
      assert eventually(fn -> up?(BB.Sensor, robot, :battery) end)
    end
  end

  describe "a sensor with a sampler process" do
    setup do
      robot =
        robot do
          parameters do
            param :range, type: {:in, [2, 4, 8, 16]}, default: 4
            param :int1_pin, type: {:or, [:non_neg_integer, nil]}
          end

          topology do
            link :base_link do
              sensor :imu,
                     {SampledImu.Sensor, range: param([:range]), sample_rate: ~u(200 hertz)}
            end
          end
        end

      start(robot)
      {:ok, _} = BB.subscribe(robot, [:sensor, :base_link, :imu], message_types: [Imu])
      %{robot: robot}
    end

    test "begins with a tick of its own, and publishes on" do
      for _ <- 1..5 do
        assert_receive {:bb, [:sensor, :base_link, :imu], %Message{payload: imu}}, 60_000
        assert_in_delta imu.linear_acceleration.z, 9.80665, 0.001
        assert_in_delta imu.angular_velocity.z, :math.pi() / 180, 1.0e-12
        assert imu.orientation == BB.Math.Quaternion.identity()
      end
    end

    test "comes back with its new options after it stops for them", %{robot: robot} do
      assert_receive {:bb, _path, %Message{payload: %Imu{}}}, 60_000
      :ok = BB.Parameter.set(robot, [:range], 16)
      assert eventually(fn -> row(BB.Sensor, robot, :imu).last_error == :reconfigure end)

      assert eventually(fn ->
               up?(BB.Sensor, robot, :imu) and user_state(robot, :imu).range == 16
             end)
    end

    test "comes back after its sampler has died", %{robot: robot} do
      assert eventually(fn -> up?(BB.Sensor, robot, :imu) end)
      sampler = user_state(robot, :imu).sampler
      Process.exit(sampler, :kill)
      assert eventually(fn -> row(BB.Sensor, robot, :imu).restarts > 0 end)
      assert eventually(fn -> up?(BB.Sensor, robot, :imu) end)
      refute user_state(robot, :imu).sampler == sampler
    end
  end

  describe "an estimator of the attitude" do
    test "turns with the rates of its sensor, in the frame of the sensor" do
      robot =
        robot do
          parameters do
            param :gain, type: :float, default: 0.0
          end

          topology do
            link :base_link do
              sensor :imu, {SampledImu.Sensor, sample_rate: ~u(200 hertz)} do
                estimator :attitude, {Attitude.Estimator, gain: param([:gain])}
              end
            end
          end
        end

      start(robot)
      path = [:sensor, :base_link, :imu, :attitude]
      {:ok, _} = BB.subscribe(robot, path)
      assert_receive {:bb, ^path, %Message{frame_id: :imu, payload: %Imu{} = first}}, 60_000
      assert_receive {:bb, ^path, %Message{payload: %Imu{} = second}}, 60_000

      # The unit turns about z alone, in the positive direction.
      assert Quaternion.z(second.orientation) > Quaternion.z(first.orientation)
      assert_in_delta Quaternion.x(second.orientation), 0.0, 1.0e-12
      assert_in_delta Quaternion.y(second.orientation), 0.0, 1.0e-12

      :ok = BB.Parameter.set(robot, [:gain], 0.25)
      assert eventually(fn -> user_state(robot, :attitude).filter.gain == 0.25 end)
    end

    test "finds the tilt by gravity" do
      tilted = Quaternion.from_axis_angle(Vec3.unit_x(), 0.3)
      acceleration = Quaternion.rotate_vector(Quaternion.conjugate(tilted), Vec3.new(0, 0, 9.8))
      filter = struct!(module("Attitude.Filter"), gain: 1.0)
      update = &module("Attitude.Filter").update(&1, Vec3.zero(), acceleration, 0.01)
      filter = filter |> Stream.iterate(update) |> Enum.at(3_000)
      assert_in_delta Quaternion.angular_distance(filter.q, tilted), 0.0, 1.0e-6
    end
  end

  describe "a controller for payloads that are options" do
    setup do
      robot =
        robot do
          controllers do
            controller :level, {
              PidController,
              kp: 2.0,
              set_point_topic: [:level, :set],
              set_point_message: PidController.Value,
              set_point_field: :value,
              measurement_topic: [:sensor, :base_link, :battery],
              measurement_message: BB.Message.Sensor.PowerState,
              measurement_field: :voltage,
              output_topic: [:level, :out],
              output_message: BB.Message.Actuator.Command.Effort,
              output_field: :effort
            }
          end

          topology do
            link :base_link do
              sensor :battery, {PowerMonitor.Sensor, bus: "i2c-1", publish_rate: ~u(50 hertz)}
            end
          end
        end

      %{robot: robot}
    end

    test "publishes its output for set point and measurement", %{robot: robot} do
      start(robot)
      {:ok, _} = BB.subscribe(robot, [:level, :out])
      assert eventually(fn -> up?(BB.Controller, robot, :level) end)
      set = Message.new!(module("PidController.Value"), :level, value: 8.4)
      :ok = BB.publish(robot, [:level, :set], set)
      assert_receive {:bb, [:level, :out], %Message{frame_id: :level, payload: output}}, 60_000
      assert %Command.Effort{effort: effort} = output
      assert_in_delta effort, 2.0, 1.0e-9
    end

    test "says which field does not fit" do
      robot =
        robot do
          controllers do
            controller :level, {
              PidController,
              set_point_topic: [:set],
              set_point_message: PidController.Value,
              set_point_field: :velue,
              measurement_topic: [:is],
              measurement_message: PidController.Value,
              measurement_field: :value,
              output_topic: [:out],
              output_message: PidController.Value,
              output_field: :value
            }
          end
        end

      start(robot)

      assert eventually(fn -> row(BB.Controller, robot, :level).last_error end) ==
               {:invalid_config, "PidController.Value has no field :velue"}
    end

    test "refuses an option that is no payload: a warning, and the robot does not start" do
      {robot, warning} =
        with_io(:stderr, fn ->
          robot do
            controllers do
              controller :level, {
                PidController,
                set_point_topic: [:set],
                set_point_message: String,
                set_point_field: :value,
                measurement_topic: [:is],
                measurement_message: PidController.Value,
                measurement_field: :value,
                output_topic: [:out],
                output_message: PidController.Value,
                output_field: :value
              }
            end
          end
        end)

      assert warning =~ "expected module that implements BB.Message, got: String"
      assert {:error, %ValidationError{key: :set_point_message}} = robot.start_link()
    end
  end

  describe "a servo that calls its controller" do
    setup do
      robot =
        robot do
          controllers do
            controller :board, {ServoBoard.Controller, bus: "i2c-1"}
          end

          topology do
            link :base_link do
              joint :pan do
                type :revolute

                limit do
                  lower(~u(-90 degree))
                  upper(~u(90 degree))
                  velocity(~u(60 degree_per_second))
                  effort(~u(1 newton_meter))
                end

                sensor :position, {BB.Sensor.OpenLoopPositionEstimator, actuator: :servo}

                actuator :servo, {ServoBoard.Actuator, controller: :board, channel: 3} do
                  transmission reversed?: true
                end

                link :head
              end
            end
          end
        end

      start(robot)
      assert eventually(fn -> up?(BB.Actuator, robot, :servo) end)
      %{robot: robot}
    end

    test "moves within its motor profile, and reports the motion of the joint", %{robot: robot} do
      {:ok, _} = BB.subscribe(robot, [:actuator], message_types: [BeginMotion])
      {:ok, _} = BB.subscribe(robot, [:sensor, :board], message_types: [JointState])
      :ok = BB.Safety.arm(robot)
      assert :ok = BB.Actuator.set_position(robot, :servo, 10.0)

      assert_receive {:bb, [:actuator, :base_link, :pan, :servo], %Message{} = begin}, 60_000
      assert %{frame_id: :pan, payload: %{initial_position: +0.0, target_position: to}} = begin
      assert_in_delta to, :math.pi() / 2, 1.0e-9
      # The servo is reversed: the joint's upper limit is the motor's lower one.
      assert BB.Process.call(robot, :board, {:pulse, 3}) == {:ok, 500}
      assert_receive {:bb, [:sensor, :board], %Message{payload: %{names: [:pan]}}}, 60_000
    end

    test "is made safe by its controller when the robot is disarmed", %{robot: robot} do
      :ok = BB.Safety.arm(robot)
      :ok = BB.Actuator.set_position(robot, :servo, 0.0)
      assert BB.Process.call(robot, :board, {:pulse, 3}) == {:ok, 1500}
      :ok = BB.Safety.disarm(robot)
      assert BB.Process.call(robot, :board, {:pulse, 3}) == {:ok, nil}

      assert {:error, %BB.Error.State.NotArmed{}} = BB.Actuator.set_position(robot, :servo, 0.5)
    end
  end

  test "a servo on a joint without limits, or on a channel that is taken, says so" do
    robot =
      robot do
        controllers do
          controller :board, {ServoBoard.Controller, bus: "i2c-1"}
        end

        topology do
          link :base_link do
            joint :free do
              type :continuous
              actuator :free_servo, {ServoBoard.Actuator, controller: :board, channel: 0}
              link :wheel
            end

            joint :pan do
              type :revolute

              limit do
                lower(~u(-90 degree))
                upper(~u(90 degree))
                velocity(~u(60 degree_per_second))
                effort(~u(1 newton_meter))
              end

              sensor :pan_position, {BB.Sensor.OpenLoopPositionEstimator, actuator: :pan_servo}
              actuator :pan_servo, {ServoBoard.Actuator, controller: :board, channel: 1}
              link :head
            end

            joint :tilt do
              type :revolute

              limit do
                lower(~u(-90 degree))
                upper(~u(90 degree))
                velocity(~u(60 degree_per_second))
                effort(~u(1 newton_meter))
              end

              sensor :tilt_position, {BB.Sensor.OpenLoopPositionEstimator, actuator: :tilt_servo}
              actuator :tilt_servo, {ServoBoard.Actuator, controller: :board, channel: 1}
              link :camera
            end
          end
        end
      end

    start(robot)

    assert %BB.Error.Invalid.JointConfig{joint: :free, field: :lower} =
             eventually(fn -> row(BB.Actuator, robot, :free_servo).last_error end)

    # Links start side by side, so that either servo may be the first on the channel.
    errors = fn ->
      for servo <- [:pan_servo, :tilt_servo],
          error = row(BB.Actuator, robot, servo).last_error,
          do: error
    end

    assert [error] = eventually(fn -> with [] <- errors.(), do: nil end)
    assert Exception.message(error) == "channel 1 has a servo already"
    assert BB.Error.critical?(error)

    assert eventually(fn ->
             Enum.count([:pan_servo, :tilt_servo], &up?(BB.Actuator, robot, &1)) == 1
           end)
  end

  describe "packages/bb" do
    for {library, files} <- [
          spark: ~w(options.ex options/validation_error.ex error/dsl_error.ex),
          localize: ~w(unit.ex)
        ] do
      @tag :tmp_dir
      test "has no module of #{library} where that is a dependency", %{tmp_dir: folder} do
        ebin = Path.join([folder, "#{unquote(library)}", "ebin"])
        File.mkdir_p!(ebin)
        true = Code.prepend_path(ebin)
        on_exit(fn -> Code.delete_path(ebin) end)

        for file <- unquote(files),
            path = Path.join("packages/bb/lib/#{unquote(library)}", file),
            do: assert(Code.compile_file(path) == [])
      end
    end

    test "has the version of the API, and no module of Ganglion" do
      assert File.read!("packages/bb/mix.exs") =~ ~s(@version "0.31.)

      modules =
        for file <- Path.wildcard("packages/bb/lib/**/*.ex"),
            module <- Source.read!(file).modules,
            do: module

      assert BB.Application in modules
      assert Enum.filter(modules, &(&1 in Application.spec(:ganglion, :modules))) == []
    end
  end
end
