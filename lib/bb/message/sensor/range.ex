defmodule BB.Message.Sensor.Range do
  @moduledoc "The distance to the nearest thing in the cone of one range sensor."

  defstruct [:radiation_type, :field_of_view, :min_range, :max_range, :range]

  @type t :: %__MODULE__{
          radiation_type: :ultrasound | :infrared,
          field_of_view: float(),
          min_range: float(),
          max_range: float(),
          range: float() | :infinity
        }

  use BB.Message,
    schema: [
      radiation_type: [
        type: {:in, [:ultrasound, :infrared]},
        required: true,
        doc: "`:ultrasound` or `:infrared`, which covers lasers."
      ],
      field_of_view: [type: :float, required: true, doc: "The cone's full angle, in rad."],
      min_range: [type: :float, required: true, doc: "Nearer is not measured, in m."],
      max_range: [type: :float, required: true, doc: "Farther is not measured, in m."],
      range: [
        type: {:or, [:float, {:literal, :infinity}]},
        required: true,
        doc: "In m; `:infinity` when nothing is in reach."
      ]
    ]
end
