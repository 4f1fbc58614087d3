defmodule BB.Dsl.ExampleTest do
  @moduledoc "A robot with everything that the DSL has, as it is written by hand."

  use ExUnit.Case, async: true

  alias BB.Parameter.Reference

  defmodule MyServo do
    use BB.Actuator, options_schema: [channel: [type: :non_neg_integer, required: true]]

    @impl BB.Actuator
    def init(_opts), do: {:ok, nil}

    @impl BB.Actuator
    def disarm(_opts), do: :ok

    @impl BB.Actuator
    def handle_command(_message, state), do: {:noreply, state}
  end

  defmodule MyRobot do
    use BB

    settings do
      name :my_robot
      parameter_store {BB.Parameter.Store.Log, path: "/data/params"}
    end

    parameters do
      param :debug, type: :boolean, default: false, doc: "…"

      group :imu do
        param :rate,
          type: {:unit, :hertz},
          default: ~u(100 hertz),
          min: ~u(1 hertz),
          max: ~u(1 kilohertz)
      end
    end

    sensors do
      sensor :battery, {BB.Sensor.Ina219, bus: "i2c-1", address: 0x40}
    end

    topology do
      link :base_link do
        sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1", rate: param([:imu, :rate])},
          required: true,
          max_silence: ~u(100 millisecond)

        joint :shoulder do
          type :revolute

          origin do
            z(~u(0.1 meter))
          end

          limit lower: ~u(-90 degree),
                upper: ~u(90 degree),
                effort: ~u(10 newton_meter),
                velocity: ~u(60 degree_per_second)

          sensor :encoder, {BB.Sensor.As5600, bus: "i2c-1"} do
            transmission do
              reduction 1.0
              offset ~u(5 degree)
              reversed? true
            end
          end

          actuator :servo, {MyServo, channel: 0}
          link :arm
        end
      end
    end
  end

  import BB.Unit, only: :sigils

  test "settings, parameters and groups are part of the robot" do
    robot = MyRobot.robot()
    assert %BB.Robot{name: MyRobot, root_link: :base_link} = robot

    assert robot.settings == %{
             name: :my_robot,
             parameter_store: {BB.Parameter.Store.Log, path: "/data/params"}
           }

    assert [%{path: [:debug], default: false, doc: "…"}, %{path: [:imu, :rate]} = rate] =
             robot.parameters

    assert {rate.default, rate.min, rate.max} ==
             {~u(100 hertz), ~u(1 hertz), ~u(1 kilohertz)}
  end

  test "its links and joints are a tree" do
    assert %{base_link: %{child_joints: [:shoulder]}, arm: %{parent_joint: :shoulder}} =
             MyRobot.robot().links

    assert %{shoulder: shoulder} = MyRobot.robot().joints
    assert {shoulder.type, shoulder.child_link} == {:revolute, :arm}
    assert shoulder.origin == %{position: {0.0, 0.0, 0.1}, orientation: {0.0, 0.0, 0.0}}
    assert_in_delta shoulder.limits.velocity, :math.pi() / 3, 1.0e-12
  end

  test "its sensors are %{name => %{name, attached_to, transmission}}" do
    assert %{
             battery: %{name: :battery, attached_to: :robot, transmission: nil},
             imu: %{name: :imu, attached_to: {:link, :base_link}, transmission: nil},
             encoder: %{name: :encoder, attached_to: {:joint, :shoulder}, transmission: encoder}
           } = MyRobot.robot().sensors

    assert %{reduction: 1.0, reversed?: true} = encoder
    assert_in_delta encoder.offset, :math.pi() / 36, 1.0e-15
    assert %{servo: %{attached_to: {:joint, :shoulder}}} = MyRobot.robot().actuators
  end

  test "its components have their paths, in the order of the declaration" do
    assert for(c <- MyRobot.robot().components, do: {c.name, c.kind, c.path}) == [
             {:battery, BB.Sensor, [:battery]},
             {:imu, BB.Sensor, [:base_link, :imu]},
             {:encoder, BB.Sensor, [:base_link, :shoulder, :encoder]},
             {:servo, BB.Actuator, [:base_link, :shoulder, :servo]}
           ]
  end

  test "its reference to a parameter is known" do
    assert {:ok, imu} = BB.Robot.fetch_component(MyRobot.robot(), :imu)
    assert imu.options == [bus: "i2c-1", rate: %Reference{path: [:imu, :rate]}]
    assert %{required: true, max_silence_ns: 100_000_000} = imu
  end
end
