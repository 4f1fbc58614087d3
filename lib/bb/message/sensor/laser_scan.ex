defmodule BB.Message.Sensor.LaserScan do
  @moduledoc """
  One sweep of a planar laser scanner, counter-clockwise about z from angle 0 along x.

      iex> {:ok, message} = BB.Message.Sensor.LaserScan.new(:lidar,
      ...>   angle_min: -0.5, angle_max: 0.5, angle_increment: 0.5, time_increment: 0.0,
      ...>   scan_time: 0.1, range_min: 0.1, range_max: 12.0, ranges: [1.0, 1.1, 1.3])
      iex> length(message.payload.ranges)
      3
  """

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
      angle_min: [type: :float, required: true, doc: "The angle of the first ray, in rad."],
      angle_max: [type: :float, required: true, doc: "The angle of the last ray, in rad."],
      angle_increment: [type: :float, required: true, doc: "The angle between two rays, in rad."],
      time_increment: [type: :float, required: true, doc: "The time between two rays, in s."],
      scan_time: [type: :float, required: true, doc: "The time between two sweeps, in s."],
      range_min: [
        type: :float,
        required: true,
        doc: "The least valid distance, in m; ignore smaller ones."
      ],
      range_max: [
        type: :float,
        required: true,
        doc: "The greatest valid distance, in m; ignore greater ones."
      ],
      ranges: [type: {:list, :float}, required: true, doc: "The distance of each ray, in m."],
      intensities: [
        type: {:list, :float},
        default: [],
        doc: "The intensity of each ray, in the unit of the device, or none."
      ]
    ]
end
