defmodule BB.Message.Sensor.Imu do
  @moduledoc """
  Rotation and acceleration of an inertial measurement unit, in the axes of its own body.

  The acceleration is the specific force: a unit at rest with z up reads about +9.81 m/s² on z. A unit that does not know its
  orientation gives `BB.Math.Quaternion.identity/0` with `BB.Math.Covariance3.unavailable/0`. A covariance of `nil` is one that
  nobody knows.
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
        doc: "From the unit's axes to the world's."
      ],
      angular_velocity: [type: {:struct, Vec3}, required: true, doc: "In rad/s."],
      linear_acceleration: [type: {:struct, Vec3}, required: true, doc: "In m/s²."],
      orientation_covariance: @covariance ++ [doc: "Of roll, pitch and yaw, in rad²."],
      angular_velocity_covariance: @covariance ++ [doc: "In rad²/s²."],
      linear_acceleration_covariance: @covariance ++ [doc: "In m²/s⁴."]
    ]
end
