defmodule BB.Message.Vision.TagDetections do
  @moduledoc """
  The tags in one camera frame. There is a message for each frame, even without a tag.

  The vision process publishes it through an inlet:

      iex> {:ok, message} = BB.Message.Vision.TagDetections.new(:camera,
      ...>   frame_sequence: 3, capture_time: 1_000_000, detections: [])
      iex> message.payload.detections
      []

  The times of the message are those of the capture, so that detections can be combined with other
  measurements. `angular_speed` is the speed at which the camera rotated at that time, by the
  inertial measurement unit: it explains a blurred tag.
  """

  alias BB.Message.Vision.TagDetection

  defstruct [
    :frame_sequence,
    :camera_frame_id,
    :image_width,
    :image_height,
    :capture_time,
    :angular_speed,
    :detections
  ]

  @type t :: %__MODULE__{
          frame_sequence: non_neg_integer(),
          camera_frame_id: non_neg_integer() | nil,
          image_width: non_neg_integer() | nil,
          image_height: non_neg_integer() | nil,
          capture_time: integer(),
          angular_speed: float() | nil,
          detections: [TagDetection.t()]
        }

  @count {:or, [:non_neg_integer, nil]}

  use BB.Message,
    schema: [
      frame_sequence: [
        type: :non_neg_integer,
        required: true,
        doc: "The sequence number of the frame on its ring."
      ],
      camera_frame_id: [
        type: @count,
        default: nil,
        doc: "The number of the frame by the camera's own count."
      ],
      image_width: [type: @count, default: nil, doc: "The width in pixels."],
      image_height: [type: @count, default: nil, doc: "The height in pixels."],
      capture_time: [
        type: :integer,
        required: true,
        doc: "The time of the capture, Erlang monotonic time in ns."
      ],
      angular_speed: [
        type: {:or, [:float, nil]},
        default: nil,
        doc: "The norm of the angular velocity at that time, in rad/s; `nil` if unknown."
      ],
      detections: [
        type: {:list, {:struct, TagDetection}},
        required: true,
        doc: "A `BB.Message.Vision.TagDetection` for each tag."
      ]
    ]
end
