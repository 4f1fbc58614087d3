defmodule BB.Handoff.Encoding.TagDetections do
  @moduledoc """
  The encoding of `BB.Message.Vision.TagDetections` as the ROS 2 message
  `apriltag_msgs/msg/AprilTagDetectionArray`, in CDR (`BB.Handoff.Cdr`).

  Use it for an inlet of the detections of `vision_tags`:

      sensor :tags_inlet,
             {BB.Handoff.Inlet, topic: "tags", encoding: BB.Handoff.Encoding.TagDetections}

  After the standard fields comes a tail that a ROS reader ignores: the frame's number, its
  capture time on the ring's clock, and the camera's angular speed at that time. The stamp is the
  capture time in wall time.

  The message's times are those of the capture, not of the arrival: the latency from the light to
  the message is `System.monotonic_time(:nanosecond) - message.monotonic_time`.
  """

  @behaviour BB.Handoff.Encoding

  alias BB.Handoff.{Cdr, Encoding}
  alias BB.Message.Vision.TagDetections
  alias BB.Message.Vision.TagDetection

  @magic 0x54474E47
  @version 1
  @angular_speed_known 1

  @point [:f64, :f64]
  # family, id, hamming, goodness, decision margin, centre, corners, homography
  @detection [:string, :i32, :i32, :f32, :f32, @point, {:array, @point, 4}, {:array, :f64, 9}]
  # magic, version, frame's sequence, camera's own count, width, height, flags, capture time,
  # angular speed
  @tail [:u32, :u32, :u64, :u32, :u32, :u32, :u32, :u64, :f64]
  @types [Encoding.header_type(), {:sequence, @detection}, {:align, 8}, @tail]

  @impl BB.Handoff.Encoding
  def content, do: "apriltag_msgs/msg/AprilTagDetectionArray"

  @impl BB.Handoff.Encoding
  def payload, do: TagDetections

  @impl BB.Handoff.Encoding
  def decode(data) do
    with {:ok, [header, detections, nil, tail]} <- Cdr.decode(data, @types),
         {:ok, frame} <- parse_tail(tail) do
      {wall_time, frame_id} = Encoding.parse_header(header)
      attrs = Map.put(frame, :detections, Enum.map(detections, &parse_detection/1))

      BB.Message.new(TagDetections, frame_id, attrs,
        monotonic_time: frame.capture_time,
        wall_time: wall_time
      )
    end
  end

  defp parse_tail([@magic, @version, sequence, count, width, height, flags, capture_ns, speed]) do
    {:ok,
     %{
       frame_sequence: sequence,
       camera_frame_id: count,
       image_width: width,
       image_height: height,
       capture_time: BB.Ring.to_monotonic_time(capture_ns),
       angular_speed: if(Bitwise.band(flags, @angular_speed_known) != 0, do: speed)
     }}
  end

  defp parse_tail([magic, version | _]), do: {:error, {:unknown_tail, magic, version}}

  defp parse_detection([family, id, hamming, _goodness, margin, [x, y], corners, homography]) do
    %TagDetection{
      family: family,
      id: id,
      hamming: hamming,
      decision_margin: margin,
      centre: {x, y},
      corners: Enum.map(corners, &List.to_tuple/1),
      homography: homography
    }
  end
end
