defmodule BB.Robot.Link do
  @moduledoc """
  A link, a rigid part of a robot. `BB.Robot` has the links of a robot.

      {:ok, link} = BB.Robot.get_link(MyRobot.robot(), :arm)
      {link.parent_joint, link.child_joints, link.mass}
      #=> {:shoulder, [], 0.4}

  All numbers are in SI units. A field without a declaration is `nil`, and so is a number that
  follows a parameter (`BB.Robot.Runtime.get_robot/1` has its value).

    * `:parent_joint` - the joint that carries the link, `nil` for the root link
    * `:child_joints` - the joints that it carries, in the order of the declaration
    * `:mass` - kg
    * `:center_of_mass` - `{x, y, z}` in the frame of the link, m
    * `:inertia` - `%{ixx: …, iyy: …, izz: …, ixy: …, ixz: …, iyz: …}`, kg·m²
    * `:visual` - `%{origin: …, geometry: …, material: …}`
    * `:collisions` - `[%{name: …, origin: …, geometry: …}]`
    * `:sensors` - the names of its sensors
  """

  defstruct [
    :name,
    :parent_joint,
    :mass,
    :center_of_mass,
    :inertia,
    :visual,
    child_joints: [],
    collisions: [],
    sensors: []
  ]

  @typedoc "Three numbers: a place in m, or roll, pitch and yaw in rad."
  @type triple :: {float() | nil, float() | nil, float() | nil}

  @typedoc "The place of a shape in the frame of its link: position and roll, pitch, yaw."
  @type origin :: {triple(), triple()} | nil

  @type geometry ::
          {:box, %{x: float(), y: float(), z: float()}}
          | {:cylinder, %{radius: float(), height: float()}}
          | {:sphere, %{radius: float()}}
          | {:capsule, %{radius: float(), length: float()}}
          | {:mesh, %{filename: String.t(), scale: number()}}

  @type material :: %{
          name: atom(),
          color: %{red: number(), green: number(), blue: number(), alpha: number()} | nil,
          texture: String.t() | nil
        }

  @type visual :: %{origin: origin(), geometry: geometry() | nil, material: material() | nil}
  @type collision :: %{name: atom(), origin: origin(), geometry: geometry() | nil}

  @type t :: %__MODULE__{
          name: atom(),
          parent_joint: atom() | nil,
          child_joints: [atom()],
          mass: float() | nil,
          center_of_mass: triple() | nil,
          inertia: %{atom() => float() | nil} | nil,
          visual: visual() | nil,
          collisions: [collision()],
          sensors: [atom()]
        }
end
