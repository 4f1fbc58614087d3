defmodule BB.RobotTest do
  use ExUnit.Case, async: true

  import BB.Test.Robot

  alias BB.Error.Kinematics.{NoParentJoint, NotAnAncestor, UnknownActuator, UnknownJoint}
  alias BB.Error.Kinematics.UnknownLink
  alias BB.Robot
  alias BB.Robot.Topology

  doctest BB.Robot.Joint
  doctest BB.Robot.Resolved
  doctest BB.Robot.Shapes
  doctest BB.Robot.Topology

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

  describe "the tree" do
    setup do
      robot =
        robot do
          topology do
            link :torso do
              joint :left do
                type :continuous
                actuator :motor, BB.Test.Motor

                link :left_arm do
                  joint :left_wrist, type: :fixed do
                    link :left_gripper
                  end
                end
              end

              joint :right do
                type :fixed
                link :right_gripper
              end
            end
          end
        end

      %{tree: robot.robot(), module: robot}
    end

    test "has a root, and joints above and below links", %{tree: tree, module: module} do
      assert Robot.root_link(tree) == :torso
      assert {:ok, %Robot.Link{name: :left_arm}} = Robot.get_link(tree, :left_arm)
      assert {:ok, %Robot.Joint{name: :left}} = Robot.get_joint(tree, :left)
      assert {:ok, %Robot.Joint{name: :left}} = Robot.parent_joint(tree, :left_arm)
      assert {:error, %NoParentJoint{link: :torso}} = Robot.parent_joint(tree, :torso)
      assert {:ok, [%{name: :left}, %{name: :right}]} = Robot.child_joints(tree, :torso)
      assert {:ok, []} = Robot.child_joints(tree, :right_gripper)

      for query <- [&Robot.get_link/2, &Robot.parent_joint/2, &Robot.child_joints/2],
          do: assert({:error, %UnknownLink{link: :nose, robot: ^module}} = query.(tree, :nose))

      assert {:error, %UnknownJoint{joint: :nose, robot: ^module}} = Robot.get_joint(tree, :nose)
    end

    test "has ways from the root and downwards", %{tree: tree, module: module} do
      way = [:torso, :left, :left_arm, :left_wrist, :left_gripper]
      assert Robot.path_to(tree, :left_gripper) == {:ok, way}
      assert Robot.path_to(tree, :left_wrist) == {:ok, Enum.take(way, 4)}
      assert Robot.path_between(tree, :left_arm, :left_gripper) == {:ok, Enum.drop(way, 2)}
      assert Robot.path_between(tree, :torso, :torso) == {:ok, [:torso]}

      assert Robot.path_between(tree, :left_gripper, :right_gripper) ==
               {:error,
                %NotAnAncestor{
                  source_link: :left_gripper,
                  target_link: :right_gripper,
                  common_ancestor: :torso
                }}

      assert {:error, %NotAnAncestor{common_ancestor: :torso}} =
               Robot.path_between(tree, :left_arm, :torso)

      assert {:error, %UnknownLink{link: :nose, robot: ^module}} = Robot.path_to(tree, :nose)

      assert {:error, %UnknownLink{role: :source, robot: ^module}} =
               Robot.path_between(tree, :nose, :torso)

      assert {:error, %UnknownLink{role: :target}} = Robot.path_between(tree, :torso, :nose)
    end

    test "has actuators with the path that their driver gets", %{tree: tree} do
      assert Robot.actuator_path(tree, :motor) == {:ok, [:torso, :left, :motor]}
      assert {:error, %UnknownActuator{actuator: :nose}} = Robot.actuator_path(tree, :nose)
    end

    test "has an order, depths and leaves", %{tree: tree} do
      links = for link <- Robot.links_in_order(tree), do: link.name
      assert links == [:torso, :left_arm, :left_gripper, :right_gripper]
      joints = for joint <- Robot.joints_in_order(tree), do: joint.name
      assert joints == [:left, :left_wrist, :right]
      assert Topology.depth_of(tree.topology, :torso) == {:ok, 0}
      assert Topology.depth_of(tree.topology, :left_gripper) == {:ok, 2}
      assert {:error, %UnknownLink{link: :nose}} = Topology.depth_of(tree.topology, :nose)
      assert Topology.max_depth(tree.topology) == 2
      assert Topology.leaf_links(tree.topology, tree) == [:left_gripper, :right_gripper]
    end
  end
end
