defmodule BB.Dsl.Joint do
  @moduledoc """
  A `joint` of a robot's declaration, which connects a link with its child link.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:name, :type, :origin, :axis, :link, :dynamics, :limit, sensors: [], actuators: []]

  @type t :: %__MODULE__{
          name: atom(),
          type: BB.Robot.Joint.type(),
          origin: BB.Dsl.Origin.t() | nil,
          axis: BB.Dsl.Axis.t() | nil,
          link: BB.Dsl.Link.t(),
          dynamics: BB.Dsl.Dynamics.t() | nil,
          limit: BB.Dsl.Limit.t() | nil,
          sensors: [BB.Dsl.Sensor.t()],
          actuators: [BB.Dsl.Actuator.t()]
        }
end
