defmodule BB.Message.Sensor.Imu do
  @moduledoc """
  A measurement of an inertial measurement unit, in the axes of its own body.

  Drivers such as `BB.Sensor.Mpu6050` publish it:

      iex> alias BB.Math.{Covariance3, Quaternion, Vec3}
      iex> {:ok, message} = BB.Message.Sensor.Imu.new(:imu,
      ...>   orientation: Quaternion.identity(),
      ...>   orientation_covariance: Covariance3.unavailable(),
      ...>   angular_velocity: Vec3.zero(),
      ...>   linear_acceleration: Vec3.new(0, 0, 9.81))
      iex> message.payload.linear_acceleration.z
      9.81

  The acceleration is the specific force: a unit at rest with z up measures about +9.81 m/s² on z.
  A unit that does not measure its orientation publishes `BB.Math.Quaternion.identity/0` with
  `BB.Math.Covariance3.unavailable/0`, as above. A covariance of `nil` is unknown.
  """

  alias BB.Math.{Covariance3, Quaternion, Vec3}

  defstruct [
    :orientation,
    :angular_velocity,
    :linear_acceleration,
    :orientation_covariance,
    :angular_velocity_covariance,
    :linear_acceleration_covariance
  ]

  @type t :: %__MODULE__{
          orientation: Quaternion.t(),
          angular_velocity: Vec3.t(),
          linear_acceleration: Vec3.t(),
          orientation_covariance: Covariance3.t() | nil,
          angular_velocity_covariance: Covariance3.t() | nil,
          linear_acceleration_covariance: Covariance3.t() | nil
        }

  @covariance [type: {:or, [{:struct, Covariance3}, nil]}, default: nil]

  use BB.Message,
    schema: [
      orientation: [
        type: {:struct, Quaternion},
        required: true,
        doc: "The rotation from the unit's axes to the world's."
      ],
      angular_velocity: [
        type: {:struct, Vec3},
        required: true,
        doc: "The angular velocity in rad/s."
      ],
      linear_acceleration: [
        type: {:struct, Vec3},
        required: true,
        doc: "The acceleration in m/s²."
      ],
      orientation_covariance:
        @covariance ++ [doc: "The covariance of roll, pitch and yaw, in rad²."],
      angular_velocity_covariance: @covariance ++ [doc: "The covariance in rad²/s²."],
      linear_acceleration_covariance: @covariance ++ [doc: "The covariance in m²/s⁴."]
    ]
end
