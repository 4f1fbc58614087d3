defmodule BB.Message.Sensor.Image do
  @moduledoc """
  An uncompressed image: `height` rows of `step` bytes, each with `width` pixels at its beginning.

  Frames of a camera are large and many: they travel by the ring, and this message is for the occasional one.
  """

  @encodings [
    :rgb8,
    :rgba8,
    :rgb16,
    :rgba16,
    :bgr8,
    :bgra8,
    :bgr16,
    :bgra16,
    :mono8,
    :mono16,
    :bayer_rggb8,
    :bayer_bggr8,
    :bayer_gbrg8,
    :bayer_grbg8
  ]

  defstruct [:height, :width, :encoding, :step, :data, is_bigendian: false]

  @type t :: %__MODULE__{
          height: non_neg_integer(),
          width: non_neg_integer(),
          encoding: atom(),
          is_bigendian: boolean(),
          step: non_neg_integer(),
          data: binary()
        }

  use BB.Message,
    schema: [
      height: [type: :non_neg_integer, required: true, doc: "Rows."],
      width: [type: :non_neg_integer, required: true, doc: "Pixels in a row."],
      encoding: [
        type: {:in, @encodings},
        required: true,
        doc: "One of #{Enum.map_join(@encodings, ", ", &"`#{inspect(&1)}`")}."
      ],
      is_bigendian: [
        type: :boolean,
        default: false,
        doc: "The byte order of encodings with 16 bits."
      ],
      step: [type: :non_neg_integer, required: true, doc: "Bytes in a row, with its padding."],
      data: [type: :string, required: true, doc: "`step * height` bytes."]
    ]
end
