defmodule BB.Robot.Link do
  @moduledoc """
  A link, a rigid part of a robot. `BB.Robot` has the links of a robot.

  `:parent_joint` is the joint that carries the link, `nil` for the root link; `:child_joints` are
  the joints that it carries.

      {:ok, link} = BB.Robot.fetch_link(MyRobot.robot(), :arm)
      {link.parent_joint, link.child_joints, link.sensors}
      #=> {:shoulder, [], []}
  """

  @enforce_keys [:name]
  defstruct [:name, :parent_joint, child_joints: [], sensors: []]

  @type t :: %__MODULE__{
          name: atom(),
          parent_joint: atom() | nil,
          child_joints: [atom()],
          sensors: [atom()]
        }
end
