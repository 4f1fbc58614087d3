defmodule BB.Message.Vision.TagDetections do
  @moduledoc """
  The tags that were found in one camera frame: a message for each frame, also where there was none.

  The envelope's times are those of the capture, so that detections can be laid beside other measurements. `angular_speed` is
  how fast the camera turned at that time, by the inertial unit's account: a blurred tag has its reason there.
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
        doc: "The frame's sequence number on its ring."
      ],
      camera_frame_id: [type: @count, default: nil, doc: "The camera's own count of its frames."],
      image_width: [type: @count, default: nil, doc: "In pixels."],
      image_height: [type: @count, default: nil, doc: "In pixels."],
      capture_time: [
        type: :integer,
        required: true,
        doc: "When the frame was captured: Erlang monotonic time in ns."
      ],
      angular_speed: [
        type: {:or, [:float, nil]},
        default: nil,
        doc: "The norm of the angular velocity at that time, in rad/s; `nil` when not known."
      ],
      detections: [
        type: {:list, {:struct, TagDetection}},
        required: true,
        doc: "One `BB.Message.Vision.TagDetection` a tag."
      ]
    ]
end
