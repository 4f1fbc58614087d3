defmodule BB.Robot.Link do
  @moduledoc """
  A link, a rigid part of a robot: its name, the joint that carries it (`nil` for the root link), the joints it carries
  and the names of its sensors.
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
