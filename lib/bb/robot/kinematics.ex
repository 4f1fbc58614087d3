defmodule BB.Robot.Kinematics do
  @moduledoc """
  Where the links of a robot are, for given positions of its joints. Pure.

      {:ok, pose} = BB.Robot.Kinematics.transform(MyRobot.robot(), :base_link, :gripper, %{
        shoulder: 0.5,
        elbow: -1.2
      })

      BB.Robot.Kinematics.all_link_transforms(MyRobot.robot(), %{})
      #=> %{base_link: %BB.Math.Transform{…}, arm: …}

  Positions are rad for a joint that turns, m for one that slides, a `BB.Math.Transform2D` for a
  planar joint and a `BB.Math.Transform` for a floating one, as in
  `BB.Robot.Runtime.configurations/1`. A joint without a position stands at its first one: zero.

  The conventions are URDF's. The origin of a joint is its frame in the parent link: moved by
  `position`, then turned by roll, pitch and yaw about the fixed axes of the parent. The joint
  moves about or along its axis in that frame, z where it has none. A planar joint moves along
  `BB.Math.Transform2D`'s two axes of the plane whose normal is the axis, and turns about it.

  Use `BB.Robot.Runtime.get_robot/1` for a robot whose origins follow parameters; a number without
  a value counts as zero.
  """

  alias BB.Error.Kinematics.{UnknownJoint, UnknownLink}
  alias BB.Math.{Quaternion, Transform, Transform2D, Vec3}
  alias BB.Robot.{Configuration, Joint, Topology}

  @type positions :: %{atom() => number() | Transform2D.t() | Transform.t()} | keyword()

  @doc """
  Returns the pose of the link `to` in the frame of the link `from`: `{:ok, transform}`.

  The transform converts the coordinates of a point in the frame of `to` to its coordinates in
  the frame of `from`. The links may be any two of the robot. Errors: an unknown link or joint,
  and a position of the wrong shape.
  """
  @spec transform(BB.Robot.t(), atom(), atom(), positions()) ::
          {:ok, Transform.t()} | {:error, Exception.t()}
  def transform(robot, from, to, positions \\ %{}) do
    with {:ok, from_path} <- path_to(robot, from, :source),
         {:ok, to_path} <- path_to(robot, to, :target),
         {:ok, positions} <- check(robot, positions) do
      shared = length(Topology.common_path(from_path, to_path))
      up = chain(robot, Enum.drop(from_path, shared), positions)
      down = chain(robot, Enum.drop(to_path, shared), positions)
      {:ok, Transform.compose(Transform.inverse(up), down)}
    end
  end

  @doc "Returns the pose of a link in the frame of the root link: `{:ok, transform}`."
  @spec forward_kinematics(BB.Robot.t(), positions(), atom()) ::
          {:ok, Transform.t()} | {:error, Exception.t()}
  def forward_kinematics(robot, positions, link),
    do: transform(robot, robot.root_link, link, positions)

  @doc """
  Returns the poses of all links in the frame of the root link, by their names.

  Raises the error of `transform/4` for wrong positions.
  """
  @spec all_link_transforms(BB.Robot.t(), positions()) :: %{atom() => Transform.t()}
  def all_link_transforms(robot, positions) do
    positions =
      case check(robot, positions) do
        {:ok, positions} -> positions
        {:error, error} -> raise error
      end

    Enum.reduce(robot.topology.link_order, %{}, fn link, poses ->
      Map.put(poses, link, pose(robot, robot.links[link], positions, poses))
    end)
  end

  defp pose(_robot, %{parent_joint: nil}, _positions, _poses), do: Transform.identity()

  defp pose(robot, %{parent_joint: name}, positions, poses) do
    joint = robot.joints[name]
    Transform.compose(poses[joint.parent_link], joint_transform(joint, positions))
  end

  @doc """
  Returns the pose of a joint's child link in its parent link, at a position of the joint.

      iex> joint = %BB.Robot.Joint{name: :j, type: :prismatic, parent_link: :a, child_link: :b}
      iex> pose = BB.Robot.Kinematics.joint_transform(joint, %{j: 0.5})
      iex> BB.Math.Transform.at(pose, 2, 3)
      0.5
  """
  @spec joint_transform(Joint.t(), %{atom() => Configuration.t()}) :: Transform.t()
  def joint_transform(%Joint{} = joint, positions) do
    position =
      Map.get_lazy(positions, joint.name, fn -> Configuration.first(joint, :configuration) end)

    Transform.compose(origin(joint.origin), motion(joint, position))
  end

  defp path_to(robot, link, role) do
    if Map.has_key?(robot.links, link),
      do: Topology.path_to(robot.topology, link),
      else: {:error, %UnknownLink{link: link, role: role, robot: robot.name}}
  end

  defp check(robot, positions) do
    Enum.reduce_while(positions, {:ok, %{}}, fn {name, value}, {:ok, checked} ->
      case check_one(robot, name, value) do
        {:ok, value} -> {:cont, {:ok, Map.put(checked, name, value)}}
        error -> {:halt, error}
      end
    end)
  end

  defp check_one(%{joints: joints} = robot, name, value) do
    case joints do
      %{^name => joint} -> Configuration.check(joint, :configuration, value)
      _ -> {:error, %UnknownJoint{joint: name, robot: robot.name}}
    end
  end

  # The joints among the names of a path.
  defp chain(robot, names, positions) do
    for name <- names, joint = robot.joints[name], reduce: Transform.identity() do
      pose -> Transform.compose(pose, joint_transform(joint, positions))
    end
  end

  defp origin(nil), do: Transform.identity()

  defp origin(%{position: {x, y, z}, orientation: {roll, pitch, yaw}}) do
    Transform.new(
      Quaternion.from_euler(roll || 0.0, pitch || 0.0, yaw || 0.0, :zyx),
      Vec3.new(x || 0.0, y || 0.0, z || 0.0)
    )
  end

  defp motion(%Joint{type: :fixed}, _position), do: Transform.identity()
  defp motion(%Joint{type: :floating}, %Transform{} = pose), do: pose

  defp motion(%Joint{type: :prismatic} = joint, distance),
    do: Transform.translation_along(axis(joint), distance)

  defp motion(%Joint{type: :planar} = joint, %Transform2D{} = pose),
    do: Transform2D.to_transform(pose, axis(joint))

  defp motion(%Joint{} = joint, angle),
    do: Transform.from_quaternion(Quaternion.from_axis_angle(axis(joint), angle))

  defp axis(%Joint{axis: nil}), do: Vec3.unit_z()
  defp axis(%Joint{axis: {x, y, z}}), do: Vec3.new(x, y, z)
end
