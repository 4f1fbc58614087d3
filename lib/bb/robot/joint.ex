defmodule BB.Robot.Joint do
  @moduledoc """
  A joint, which connects a parent link with a child link. `BB.Robot` has the joints of a robot.

  `:origin`, `:axis`, `:limit` and `:dynamics` are maps of the declared fields, `nil` where the
  declaration has none. Quantities are `BB.Unit` structs; a field that follows a parameter is a
  `BB.Parameter.Reference`.

      {:ok, joint} = BB.Robot.fetch_joint(MyRobot.robot(), :shoulder)
      {joint.type, joint.parent_link, joint.child_link}
      #=> {:revolute, :base_link, :arm}
  """

  @enforce_keys [:name, :type, :parent_link, :child_link]
  defstruct [
    :name,
    :type,
    :parent_link,
    :child_link,
    :origin,
    :axis,
    :limit,
    :dynamics,
    sensors: [],
    actuators: []
  ]

  @type t :: %__MODULE__{
          name: atom(),
          type: :revolute | :continuous | :prismatic | :fixed,
          parent_link: atom(),
          child_link: atom(),
          origin: %{atom() => BB.Unit.t() | BB.Parameter.Reference.t()} | nil,
          axis: %{atom() => number() | BB.Parameter.Reference.t()} | nil,
          limit: %{atom() => BB.Unit.t() | BB.Parameter.Reference.t()} | nil,
          dynamics: %{atom() => number()} | nil,
          sensors: [atom()],
          actuators: [atom()]
        }
end
