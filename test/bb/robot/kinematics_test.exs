defmodule BB.Robot.KinematicsTest do
  use ExUnit.Case, async: true

  import BB.Test.Robot

  alias BB.Error.Invalid.JointConfig
  alias BB.Error.Kinematics.{UnknownJoint, UnknownLink}
  alias BB.Math.{Quaternion, Transform, Transform2D, Vec3}
  alias BB.Robot
  alias BB.Robot.Kinematics

  doctest BB.Robot.Configuration
  doctest BB.Robot.Kinematics

  # oracle.py has the same robot as a URDF.
  setup_all do
    robot =
      robot do
        topology do
          link :base do
            joint :shoulder do
              type :revolute
              limit effort: ~u(1 newton_meter), velocity: ~u(1 radian_per_second)

              origin x: ~u(0.1 meter),
                     y: ~u(-0.2 meter),
                     z: ~u(0.3 meter),
                     roll: ~u(0.3 radian),
                     pitch: ~u(-0.5 radian),
                     yaw: ~u(0.7 radian)

              link :upper do
                joint :elbow do
                  type :continuous

                  origin y: ~u(0.25 meter),
                         z: ~u(0.1 meter),
                         roll: ~u(-1.1 radian),
                         pitch: ~u(0.4 radian),
                         yaw: ~u(0.2 radian)

                  axis x: 3, z: 4

                  link :lower do
                    joint :wrist do
                      type :revolute
                      limit effort: ~u(1 newton_meter), velocity: ~u(1 radian_per_second)
                      origin x: ~u(0.2 meter), yaw: ~u(1.5 radian)
                      axis roll: ~u(10 degree), pitch: ~u(20 degree), yaw: ~u(30 degree)

                      link :hand do
                        joint :slide do
                          type :prismatic
                          limit effort: ~u(1 newton), velocity: ~u(1 meter_per_second)

                          origin y: ~u(0.03 meter),
                                 z: ~u(0.05 meter),
                                 roll: ~u(0.2 radian),
                                 pitch: ~u(0.9 radian),
                                 yaw: ~u(-0.4 radian)

                          axis roll: ~u(-90 degree)
                          link :finger
                        end

                        joint :mount do
                          type :fixed

                          origin x: ~u(0.05 meter),
                                 y: ~u(0.02 meter),
                                 z: ~u(0.08 meter),
                                 roll: ~u(2.1 radian),
                                 pitch: ~u(-0.3 radian),
                                 yaw: ~u(1.2 radian)

                          link :camera
                        end
                      end
                    end
                  end
                end
              end
            end

            joint :table do
              type :planar

              origin x: ~u(-0.5 meter),
                     y: ~u(0.6 meter),
                     roll: ~u(0.1 radian),
                     pitch: ~u(0.2 radian),
                     yaw: ~u(0.3 radian)

              axis do
              end

              link :cart
            end

            joint :free do
              type :floating

              origin z: ~u(1 meter),
                     roll: ~u(0.4 radian),
                     pitch: ~u(0.5 radian),
                     yaw: ~u(0.6 radian)

              link :drone
            end
          end
        end
      end

    {:ok, table} = :file.consult("test/support/kinematics/transforms.terms")
    %{robot: robot.robot(), table: table}
  end

  test "the transforms between links are Pinocchio's", %{robot: robot, table: table} do
    assert length(table) == 4

    for {positions, rows} <- table, {from, to, matrix} <- rows do
      assert {:ok, pose} = Robot.transform(robot, from, to, configurations(positions))
      assert_close(Transform.to_list(pose), matrix, {from, to})
    end
  end

  test "all links at once have the same poses", %{robot: robot, table: table} do
    for {positions, _rows} <- table, positions = configurations(positions) do
      poses = Kinematics.all_link_transforms(robot, positions)
      assert Enum.sort(Map.keys(poses)) == Enum.sort(Map.keys(robot.links))

      for {link, pose} <- poses do
        assert {:ok, alone} = Kinematics.forward_kinematics(robot, positions, link)
        assert_close(Transform.to_list(pose), Transform.to_list(alone), link)
      end
    end
  end

  test "the way there and back is no way", %{robot: robot, table: [{positions, _rows} | _]} do
    positions = configurations(positions)
    {:ok, there} = Robot.transform(robot, :camera, :drone, positions)
    {:ok, back} = Robot.transform(robot, :drone, :camera, positions)
    identity = Transform.to_list(Transform.identity())
    assert_close(Transform.to_list(Transform.compose(there, back)), identity, :both)
  end

  test "a joint without a position stands at zero", %{robot: robot} do
    zero = %{shoulder: 0, elbow: 0.0, wrist: 0, slide: 0.0, mount: 0}
    assert Robot.transform(robot, :base, :camera) == Robot.transform(robot, :base, :camera, zero)
  end

  test "a plane may stand in any direction", %{robot: robot} do
    joints = Map.update!(robot.joints, :table, &%{&1 | origin: nil, axis: {1.0, 0.0, 0.0}})
    turn = %{table: Transform2D.new(1.0, 2.0, :math.pi() / 2)}
    assert {:ok, pose} = Robot.transform(%{robot | joints: joints}, :base, :cart, turn)

    # For the normal x the axes of the plane are y and z.
    assert_close(
      Transform.to_list(pose),
      [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 1.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0],
      :cart
    )
  end

  test "unknown links and joints, and positions of a wrong shape, are errors", %{robot: robot} do
    assert {:error, %UnknownLink{link: :nose, role: :source}} =
             Robot.transform(robot, :nose, :base)

    assert {:error, %UnknownLink{link: :elbow, role: :target}} =
             Robot.transform(robot, :base, :elbow)

    assert {:error, %UnknownJoint{joint: :knee}} =
             Robot.transform(robot, :base, :hand, %{knee: 1.0})

    assert {:error, %JointConfig{joint: :table, value: 1.0}} =
             Robot.transform(robot, :base, :hand, %{table: 1.0})

    assert_raise JointConfig, fn -> Kinematics.all_link_transforms(robot, %{mount: 1}) end
  end

  defp configurations(positions) do
    for {name, value} <- positions, into: %{}, do: {name, configuration(value)}
  end

  defp configuration([x, y, theta]), do: Transform2D.new(x, y, theta)

  defp configuration([x, y, z, qw, qx, qy, qz]),
    do: Transform.new(Quaternion.new(qw, qx, qy, qz), Vec3.new(x, y, z))

  defp configuration(value), do: value

  defp assert_close(given, expected, what) do
    for {a, b} <- Enum.zip(given, expected),
        do: assert_in_delta(a, b, 1.0e-12, "#{inspect(what)}: #{inspect(given)}")
  end
end
