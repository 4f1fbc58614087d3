defmodule BB.Message.Sensor.Range do
  @moduledoc """
  The distance to the nearest object in the cone of one range sensor.

  Drivers such as `BB.Sensor.HcSr04` publish it:

      iex> {:ok, message} = BB.Message.Sensor.Range.new(:front, radiation_type: :ultrasound,
      ...>   field_of_view: 0.26, min_range: 0.02, max_range: 4.0, range: :infinity)
      iex> message.payload.range
      :infinity
  """

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
        doc: "`:ultrasound` or `:infrared`, which includes lasers."
      ],
      field_of_view: [type: :float, required: true, doc: "The full angle of the cone, in rad."],
      min_range: [
        type: :float,
        required: true,
        doc: "The least distance that the sensor measures, in m."
      ],
      max_range: [
        type: :float,
        required: true,
        doc: "The greatest distance that the sensor measures, in m."
      ],
      range: [
        type: {:or, [:float, {:literal, :infinity}]},
        required: true,
        doc: "The distance in m; `:infinity` if there is no object within reach."
      ]
    ]
end
