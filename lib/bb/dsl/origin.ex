defmodule BB.Dsl.Origin do
  @moduledoc """
  An `origin` of a robot's declaration: a place and an orientation in the frame around it.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  import BB.Unit, only: [sigil_u: 2]

  defstruct x: ~u(0 meter),
            y: ~u(0 meter),
            z: ~u(0 meter),
            roll: ~u(0 degree),
            pitch: ~u(0 degree),
            yaw: ~u(0 degree)

  @type t :: %__MODULE__{
          x: BB.Unit.t() | BB.Parameter.Reference.t(),
          y: BB.Unit.t() | BB.Parameter.Reference.t(),
          z: BB.Unit.t() | BB.Parameter.Reference.t(),
          roll: BB.Unit.t() | BB.Parameter.Reference.t(),
          pitch: BB.Unit.t() | BB.Parameter.Reference.t(),
          yaw: BB.Unit.t() | BB.Parameter.Reference.t()
        }
end
