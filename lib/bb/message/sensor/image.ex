defmodule BB.Message.Sensor.Image do
  @moduledoc """
  An uncompressed image: `height` rows of `step` bytes, each with `width` pixels at its beginning.

  Use it for single images. The frames of a camera are large and frequent, and are sent by the
  ring.

      iex> {:ok, message} = BB.Message.Sensor.Image.new(:camera,
      ...>   height: 2, width: 2, step: 2, encoding: :mono8, data: <<1, 2, 3, 4>>)
      iex> byte_size(message.payload.data)
      4
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
      height: [type: :non_neg_integer, required: true, doc: "The number of rows."],
      width: [type: :non_neg_integer, required: true, doc: "The number of pixels in a row."],
      encoding: [
        type: {:in, @encodings},
        required: true,
        doc: "One of #{Enum.map_join(@encodings, ", ", &"`#{inspect(&1)}`")}."
      ],
      is_bigendian: [
        type: :boolean,
        default: false,
        doc: "Whether values of 16 bits are big-endian."
      ],
      step: [
        type: :non_neg_integer,
        required: true,
        doc: "The number of bytes in a row, padding included."
      ],
      data: [type: :string, required: true, doc: "The pixels, `step * height` bytes."]
    ]
end
