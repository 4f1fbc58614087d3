defmodule BB.Dsl.Axis do
  @moduledoc """
  The `axis` of a joint: the z axis turned by `roll`, `pitch` and `yaw`, or the direction
  `x`, `y`, `z`.
  `BB.Dsl.Info` returns it with its fields as written: quantities are `BB.Unit` structs, and a
  field that follows a parameter is a `BB.Parameter.Reference`.
  """
  @moduledoc no_example: "BB.Dsl has an example of the whole language"

  import BB.Unit, only: [sigil_u: 2]

  defstruct [:x, :y, :z, roll: ~u(0 degree), pitch: ~u(0 degree), yaw: ~u(0 degree)]

  @type t :: %__MODULE__{
          x: number() | BB.Parameter.Reference.t() | nil,
          y: number() | BB.Parameter.Reference.t() | nil,
          z: number() | BB.Parameter.Reference.t() | nil,
          roll: BB.Unit.t() | BB.Parameter.Reference.t(),
          pitch: BB.Unit.t() | BB.Parameter.Reference.t(),
          yaw: BB.Unit.t() | BB.Parameter.Reference.t()
        }
end
