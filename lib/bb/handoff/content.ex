defmodule BB.Handoff.Content do
  @moduledoc """
  The names of encodings by their content tags.

  `BB.Handoff.Inlet` uses it to name an encoding in a message to a person. A topic's header holds
  only a tag, a hash of the encoding's name (`BB.Ring.content_tag/1`); this table has the common
  names.

      iex> tag = BB.Ring.content_tag("sensor_msgs/msg/Image")
      iex> BB.Handoff.Content.name(tag)
      "sensor_msgs/msg/Image"
  """

  @names ~w(
    conduit/frame
    apriltag_msgs/msg/AprilTagDetectionArray
    diagnostic_msgs/msg/DiagnosticArray
    geometry_msgs/msg/PoseWithCovarianceStamped
    geometry_msgs/msg/TransformStamped
    geometry_msgs/msg/TwistStamped
    nav_msgs/msg/Odometry
    rcl_interfaces/msg/Log
    rcl_interfaces/msg/ParameterEvent
    rosgraph_msgs/msg/Clock
    sensor_msgs/msg/BatteryState
    sensor_msgs/msg/CameraInfo
    sensor_msgs/msg/CompressedImage
    sensor_msgs/msg/FluidPressure
    sensor_msgs/msg/Illuminance
    sensor_msgs/msg/Image
    sensor_msgs/msg/Imu
    sensor_msgs/msg/JointState
    sensor_msgs/msg/LaserScan
    sensor_msgs/msg/MagneticField
    sensor_msgs/msg/NavSatFix
    sensor_msgs/msg/PointCloud2
    sensor_msgs/msg/Range
    sensor_msgs/msg/RelativeHumidity
    sensor_msgs/msg/Temperature
    std_msgs/msg/Bool
    std_msgs/msg/Float64
    std_msgs/msg/String
    tf2_msgs/msg/TFMessage
  )

  @doc """
  Returns the name of the encoding with a tag.

  It is the tag itself when its name is not known, and `:untagged` for 0.

      iex> "sensor_msgs/msg/LaserScan" |> BB.Ring.content_tag() |> BB.Handoff.Content.name()
      "sensor_msgs/msg/LaserScan"

      iex> {BB.Handoff.Content.name(0), BB.Handoff.Content.name(17)}
      {:untagged, 17}
  """
  @spec name(non_neg_integer()) :: String.t() | non_neg_integer() | :untagged
  def name(0), do: :untagged
  def name(tag), do: Enum.find(@names, tag, &(BB.Ring.content_tag(&1) == tag))

  @doc """
  Formats a topic's content that an inlet does not decode as a sentence that says what to do.

      iex> BB.Handoff.Content.explain("sensor_msgs/msg/LaserScan")
      "the topic has messages of sensor_msgs/msg/LaserScan, which the inlet's encoding does " <>
        "not decode: set their encoding, or another topic"
  """
  @spec explain(String.t() | non_neg_integer() | :untagged) :: String.t()
  def explain(:untagged) do
    "the topic has no content tag: set `content` in its publisher, or accept its messages " <>
      "by `untagged: true` in the inlet's options"
  end

  def explain(tag) when is_integer(tag),
    do: explain("an encoding with the content tag 0x" <> Integer.to_string(tag, 16))

  def explain(name) do
    "the topic has messages of #{name}, which the inlet's encoding does not decode: " <>
      "set their encoding, or another topic"
  end
end
