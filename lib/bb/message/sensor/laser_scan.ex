defmodule BB.Message.Sensor.LaserScan do
  @moduledoc "One sweep of a planar laser scanner, counter-clockwise about z, angle 0 along x."

  defstruct [
    :angle_min,
    :angle_max,
    :angle_increment,
    :time_increment,
    :scan_time,
    :range_min,
    :range_max,
    :ranges,
    intensities: []
  ]

  @type t :: %__MODULE__{
          angle_min: float(),
          angle_max: float(),
          angle_increment: float(),
          time_increment: float(),
          scan_time: float(),
          range_min: float(),
          range_max: float(),
          ranges: [float()],
          intensities: [float()]
        }

  use BB.Message,
    schema: [
      angle_min: [type: :float, required: true, doc: "Of the first ray, in rad."],
      angle_max: [type: :float, required: true, doc: "Of the last ray, in rad."],
      angle_increment: [type: :float, required: true, doc: "From ray to ray, in rad."],
      time_increment: [type: :float, required: true, doc: "From ray to ray, in s."],
      scan_time: [type: :float, required: true, doc: "From sweep to sweep, in s."],
      range_min: [type: :float, required: true, doc: "Nearer is to be ignored, in m."],
      range_max: [type: :float, required: true, doc: "Farther is to be ignored, in m."],
      ranges: [type: {:list, :float}, required: true, doc: "A distance for each ray, in m."],
      intensities: [
        type: {:list, :float},
        default: [],
        doc: "A value for each ray, or none; in the device's own unit."
      ]
    ]
end
