defmodule BB.RobotTest do
  use ExUnit.Case, async: true

  import BB.Test.Robot

  alias BB.Robot

  setup do
    robot =
      robot do
        sensors do
          sensor :battery, BB.Test.Probe
        end

        topology do
          link :base do
            sensor :imu, BB.Test.Probe

            joint :elbow do
              type :fixed
              sensor :encoder, BB.Test.Probe
              link :arm
            end
          end
        end
      end

    %{declared: robot.robot()}
  end

  test "links, joints and components are found by name", %{declared: declared} do
    assert {:ok, %Robot.Link{name: :arm, parent_joint: :elbow}} = Robot.fetch_link(declared, :arm)
    assert {:ok, %Robot.Joint{child_link: :arm}} = Robot.fetch_joint(declared, :elbow)
    assert {:ok, %BB.Component{path: [:base, :imu]}} = Robot.fetch_component(declared, :imu)
  end

  test "what is not there is :error", %{declared: declared} do
    assert Robot.fetch_link(declared, :elbow) == :error
    assert Robot.fetch_joint(declared, :arm) == :error
    assert Robot.fetch_component(declared, :base) == :error
  end

  test "the components on the robot, on a link and on a joint", %{declared: declared} do
    names = fn place ->
      for component <- Robot.components_on(declared, place), do: component.name
    end

    assert names.(nil) == [:battery]
    assert names.({:link, :base}) == [:imu]
    assert names.({:joint, :elbow}) == [:encoder]
    assert names.({:link, :arm}) == []
  end

  test "a component knows the paths on which it is heard", %{declared: declared} do
    {:ok, imu} = Robot.fetch_component(declared, :imu)
    assert BB.Component.data_path(imu) == [:sensor, :base, :imu]
    assert BB.Component.status_path(imu) == [:sensor_status, :base, :imu]
  end
end
