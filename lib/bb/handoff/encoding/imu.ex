defmodule BB.Handoff.Encoding.Imu do
  @moduledoc """
  The encoding of `BB.Message.Sensor.Imu` as the ROS 2 message `sensor_msgs/msg/Imu`, in CDR
  (`BB.Handoff.Cdr`).

  Use it for an outlet or an inlet of IMU samples:

      sensor :imu_outlet,
             {BB.Handoff.Outlet,
              from: [:sensor, :base_link, :imu],
              topic: "imu",
              encoding: BB.Handoff.Encoding.Imu}

  The stamp is the message's wall time. An unknown covariance is encoded as zeros, as in ROS. A
  `frame_id` that is no atom of this node is decoded as `:unknown`.
  """

  @behaviour BB.Handoff.Encoding

  alias BB.Handoff.{Cdr, Encoding}
  alias BB.Math.{Covariance3, Quaternion, Vec3}
  alias BB.Message.Sensor.Imu

  # header; orientation, angular velocity and linear acceleration, each with its covariance
  @vector {:array, :f64, 3}
  @covariance {:array, :f64, 9}
  @types [
    Encoding.header_type(),
    {:array, :f64, 4},
    @covariance,
    @vector,
    @covariance,
    @vector,
    @covariance
  ]

  @impl BB.Handoff.Encoding
  def content, do: "sensor_msgs/msg/Imu"

  @impl BB.Handoff.Encoding
  def payload, do: Imu

  @impl BB.Handoff.Encoding
  def encode(%BB.Message{payload: %Imu{} = imu} = message) do
    %Quaternion{w: w, x: x, y: y, z: z} = imu.orientation

    Cdr.encode(@types, [
      Encoding.header_values(message.wall_time, message.frame_id),
      [x, y, z, w],
      covariance(imu.orientation_covariance),
      vector(imu.angular_velocity),
      covariance(imu.angular_velocity_covariance),
      vector(imu.linear_acceleration),
      covariance(imu.linear_acceleration_covariance)
    ])
  end

  @impl BB.Handoff.Encoding
  def decode(data) do
    with {:ok,
          [
            header,
            [x, y, z, w],
            c_orientation,
            velocity,
            c_velocity,
            acceleration,
            c_acceleration
          ]} <-
           Cdr.decode(data, @types) do
      {wall_time, frame_id} = Encoding.parse_header(header)

      BB.Message.new(
        Imu,
        frame_id,
        [
          orientation: %Quaternion{w: w, x: x, y: y, z: z},
          angular_velocity: parse_vector(velocity),
          linear_acceleration: parse_vector(acceleration),
          orientation_covariance: parse_covariance(c_orientation),
          angular_velocity_covariance: parse_covariance(c_velocity),
          linear_acceleration_covariance: parse_covariance(c_acceleration)
        ],
        wall_time: wall_time
      )
    end
  end

  defp vector(%Vec3{x: x, y: y, z: z}), do: [x, y, z]
  defp parse_vector([x, y, z]), do: %Vec3{x: x, y: y, z: z}

  defp covariance(nil), do: covariance(Covariance3.zero())
  defp covariance(%Covariance3{m: m}), do: Tuple.to_list(m)

  defp parse_covariance(elements) do
    covariance = Covariance3.new(elements)
    if covariance == Covariance3.zero(), do: nil, else: covariance
  end
end
