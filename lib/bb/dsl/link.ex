defmodule BB.Dsl.Link do
  @moduledoc """
  A `link` of a robot's declaration: a rigid part, with what it carries.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  defstruct [:name, :visual, :inertial, joints: [], sensors: [], estimators: [], collisions: []]

  @type t :: %__MODULE__{
          name: atom(),
          visual: BB.Dsl.Visual.t() | nil,
          inertial: BB.Dsl.Inertial.t() | nil,
          joints: [BB.Dsl.Joint.t()],
          sensors: [BB.Dsl.Sensor.t()],
          estimators: [BB.Dsl.Estimator.t()],
          collisions: [BB.Dsl.Collision.t()]
        }
end
