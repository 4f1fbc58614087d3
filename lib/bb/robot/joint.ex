defmodule BB.Robot.Joint do
  @moduledoc """
  A joint, which connects a parent link with a child link. `BB.Robot` has the joints of a robot.

      {:ok, joint} = BB.Robot.get_joint(MyRobot.robot(), :shoulder)
      {joint.type, joint.child_link, joint.limits.upper}
      #=> {:revolute, :arm, 1.5707963267948966}

  All numbers are in SI units: rad and m, N·m and N, rad/s and m/s. A part without a declaration
  is `nil`, and so is a number that follows a parameter (`BB.Robot.Runtime.get_robot/1` has its
  value).

    * `:origin` - the frame of the joint in its parent link,
      `%{position: {x, y, z}, orientation: {roll, pitch, yaw}}`
    * `:axis` - the direction `{x, y, z}` about which it turns or along which it slides, a unit
      vector in the frame of the joint; `nil` stands for z. The normal of a planar joint's plane
    * `:limits` - `%{lower: …, upper: …, velocity: …, effort: …, acceleration: …}`
    * `:dynamics` - `%{damping: …, friction: …}`
    * `:sensors`, `:actuators` - the names of those on the joint
  """

  defstruct [
    :name,
    :type,
    :parent_link,
    :child_link,
    :origin,
    :axis,
    :limits,
    :dynamics,
    sensors: [],
    actuators: []
  ]

  @type type :: :revolute | :continuous | :prismatic | :fixed | :floating | :planar

  @type origin :: %{position: BB.Robot.Link.triple(), orientation: BB.Robot.Link.triple()}

  @type limits :: %{
          lower: float() | nil,
          upper: float() | nil,
          velocity: float() | nil,
          effort: float() | nil,
          acceleration: float() | nil
        }

  @type t :: %__MODULE__{
          name: atom(),
          type: type(),
          parent_link: atom(),
          child_link: atom(),
          origin: origin() | nil,
          axis: {float(), float(), float()} | nil,
          limits: limits() | nil,
          dynamics: %{damping: float() | nil, friction: float() | nil} | nil,
          sensors: [atom()],
          actuators: [atom()]
        }

  @doc "Tells whether the joint turns: a revolute or a continuous joint."
  @spec rotational?(t()) :: boolean()
  def rotational?(%__MODULE__{type: type}), do: type in [:revolute, :continuous]

  @doc "Tells whether the joint slides: a prismatic joint."
  @spec linear?(t()) :: boolean()
  def linear?(%__MODULE__{type: type}), do: type == :prismatic

  @doc "Tells whether the joint moves: every joint but a fixed one."
  @spec movable?(t()) :: boolean()
  def movable?(%__MODULE__{type: type}), do: type != :fixed

  @doc """
  Returns the degrees of freedom of the joint.

      iex> joint = %BB.Robot.Joint{name: :j, type: :planar, parent_link: :a, child_link: :b}
      iex> {BB.Robot.Joint.dof(joint), BB.Robot.Joint.dof(%{joint | type: :revolute})}
      {3, 1}
  """
  @spec dof(t()) :: 0 | 1 | 3 | 6
  def dof(%__MODULE__{type: :fixed}), do: 0
  def dof(%__MODULE__{type: :planar}), do: 3
  def dof(%__MODULE__{type: :floating}), do: 6
  def dof(%__MODULE__{}), do: 1
end
